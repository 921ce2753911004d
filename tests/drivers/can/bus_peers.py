"""What the tests of interoperability share: our end of a bus (bus_lines), frames as candump writes
them, and python-can messages made from and compared with them."""
import os
import random
import subprocess
import sys

import can

BUS_LINES = os.environ["BUS_LINES"]
FD_LENGTHS = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64]
PATIENCE_S = 30


def frame_texts(lines):
    """The frames of a candump log, without times and names. Newer kernels mark FD frames with a flag
    of their own, 4, which is no part of the frame."""
    texts = []
    for line in lines:
        text = line.split()[2]
        identifier, fd, rest = text.partition("##")
        if fd:
            text = f"{identifier}##{int(rest[0], 16) & 3:X}{rest[1:]}"
        texts.append(text)
    return texts


def random_frames(count, seed, kinds=("data", "remote", "fd")):
    """Texts of `count` random frames as candump writes them."""
    draw = random.Random(seed)
    texts = []
    for _ in range(count):
        kind = draw.choice(kinds)
        if kind == "error":
            texts.append(f"{0x20000000 | draw.randrange(1, 0x400):08X}#{draw.randbytes(8).hex().upper()}")
            continue
        identifier = f"{draw.randrange(1 << 29):08X}" if draw.random() < 0.5 else f"{draw.randrange(1 << 11):03X}"
        if kind == "remote":
            length = draw.randrange(9)
            texts.append(f"{identifier}#R{length or ''}")
        elif kind == "fd":
            data = draw.randbytes(draw.choice(FD_LENGTHS)).hex().upper()
            texts.append(f"{identifier}##{draw.randrange(4):X}{data}")
        else:
            texts.append(f"{identifier}#{draw.randbytes(draw.randrange(9)).hex().upper()}")
    return texts


def as_log(texts, interface="vcan0"):
    """A candump log of the frames, one each 100 us."""
    return "".join(f"({1000 + n // 10000}.{n % 10000 * 100:06d}) {interface} {text}\n"
                   for n, text in enumerate(texts))


def as_message(text):
    """The frame as a can.Message."""
    identifier, _, rest = text.partition("#")
    number = int(identifier, 16)
    is_error = len(identifier) == 8 and number & 0x20000000 != 0
    message = can.Message(arbitration_id=number & 0x1FFFFFFF, is_error_frame=is_error,
                          is_extended_id=len(identifier) == 8 and (not is_error or number & 0x1FFFFFFF > 0x7FF))
    if rest.startswith("#"):
        message.is_fd = True
        message.bitrate_switch = int(rest[1], 16) & 1 != 0
        message.error_state_indicator = int(rest[1], 16) & 2 != 0
        message.data = bytearray.fromhex(rest[2:])
    elif rest.startswith("R"):
        message.is_remote_frame = True
        message.dlc = int(rest[1:] or 0)
        return message
    else:
        message.data = bytearray.fromhex(rest)
    message.dlc = len(message.data)
    return message


def as_text(message):
    """A can.Message as candump would write it."""
    if message.is_error_frame:
        identifier = f"{message.arbitration_id | 0x20000000:08X}"
    else:
        identifier = f"{message.arbitration_id:08X}" if message.is_extended_id else f"{message.arbitration_id:03X}"
    if message.is_fd:
        flags = message.bitrate_switch + 2 * message.error_state_indicator
        return f"{identifier}##{flags:X}{message.data.hex().upper()}"
    if message.is_remote_frame:
        return f"{identifier}#R{message.dlc or ''}"
    return f"{identifier}#{message.data.hex().upper()}"


class Reader:
    """Our end of a bus, reading `count` frames from now on."""

    def __init__(self, spec, count):
        self.process = subprocess.Popen([BUS_LINES, "dump", spec, str(count)], stdout=subprocess.PIPE,
                                        stderr=subprocess.PIPE, text=True)
        said = self.process.stderr.readline()
        assert said == "ready\n", said

    def frames(self):
        """What came, and the last word of the bus about its counters."""
        out, self.counters = self.process.communicate(timeout=PATIENCE_S)
        assert self.process.returncode == 0, f"{len(out.splitlines())} frames came: {self.counters}"
        return frame_texts(out.splitlines())


def send(spec, texts):
    """Sends the frames from our end of a bus."""
    result = subprocess.run([BUS_LINES, "send", spec], input=as_log(texts), text=True, timeout=PATIENCE_S,
                            stderr=subprocess.PIPE)
    assert result.returncode == 0, result.stderr
    assert f"sent {len(texts)} send_errors 0 " in result.stderr, result.stderr


def exchange_with_python_can(test, spec, texts, **bus_arguments):
    """Each frame from python-can to us and from us to python-can."""
    reader = Reader(spec, len(texts))
    with can.Bus(**bus_arguments) as peer:
        for text in texts:
            peer.send(as_message(text))
        test.assertEqual(reader.frames(), texts)
        while peer.recv(0.0):  # its own, which udp_multicast hears
            pass
        # Fifty at a time: python-can's socket holds few frames.
        for begin in range(0, len(texts), 50):
            part = texts[begin:begin + 50]
            send(spec, part)
            received = []
            while len(received) < len(part):
                message = peer.recv(10.0)
                test.assertIsNotNone(message, f"{len(received)} of {len(part)} came")
                received.append(as_text(message))
            test.assertEqual(received, part)
        test.assertIsNone(peer.recv(0.05))


if __name__ == "__main__":
    sys.exit("a module of can_interoperability_test.py and udp_interoperability_test.py")
