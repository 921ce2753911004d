#!/usr/bin/python3
"""can: against candump, cansend, cangen, canplayer, cangw and python-can, frame by frame.

Run inside tools/with-vcan -i vcan0 -i vcan1 -M can-gw, with BUS_LINES naming the program bus_lines.
"""
import os
import select
import socket
import struct
import subprocess
import tempfile
import unittest

from bus_peers import PATIENCE_S, Reader, as_log, exchange_with_python_can, frame_texts, random_frames, send

MARKER = "7FF#4D41524B4552"


def run(*command):
    subprocess.run(command, check=True, timeout=PATIENCE_S)


class Candump:
    """candump -L, which listens once this is there. `send_marker` sends a frame of the text `marker`."""

    def __init__(self, argument, marker, send_marker):
        self.marker = marker
        # Without a buffer, so that select tells all there is to read.
        self.process = subprocess.Popen(["candump", "-L", argument], stdout=subprocess.PIPE, bufsize=0)
        while not select.select([self.process.stdout], [], [], 0.02)[0]:
            send_marker()

    def frames(self, count):
        """The next `count` frames that are no markers."""
        texts = []
        while len(texts) < count:
            line = self.process.stdout.readline().decode()
            texts += [text for text in frame_texts([line]) if text != self.marker]
        return texts

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.communicate()


def candump(interface):
    def send_marker():
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as sender:
            sender.bind((interface,))
            sender.send(struct.pack("=IB3x8s", 0x7FF, 6, bytes.fromhex(MARKER[4:]).ljust(8, b"\0")))
    return Candump(interface, MARKER, send_marker)


class CanInteroperability(unittest.TestCase):
    def test_candump_prints_what_we_send(self):
        with candump("vcan0") as peer:
            for seed in range(4):
                texts = random_frames(100, seed)
                send("can:vcan0", texts)
                self.assertEqual(peer.frames(100), texts)

    def test_candump_prints_the_error_frames_we_send(self):
        marker = "20000001#0000000000000000"
        with Candump("vcan1,0:0,#FFFFFFFF", marker, lambda: send("can:vcan1", [marker])) as peer:
            texts = random_frames(50, 1, ["error"])
            send("can:vcan1", texts)
            self.assertEqual(peer.frames(50), texts)

    def test_we_read_what_cansend_sends(self):
        texts = ["123#DEADBEEF", "5A1#1122334455667788", "1F334455#1122334455667788", "123#", "00000123#R",
                 "123#R5", "123##1", "213##311", "1F334455##2" + "A5" * 64, "7FF##0" + "00" * 12]
        given = ["123#DEADBEEF", "5A1#11.22.33.44.55.66.77.88", "1F334455#1122334455667788", "123#", "00000123#R",
                 "123#R5", "123##1", "213##311", "1F334455##2" + "A5" * 64, "7FF##0" + "00" * 12]
        reader = Reader("can:vcan0", len(texts))
        for text in given:
            run("cansend", "vcan0", text)
        self.assertEqual(reader.frames(), texts)

    def test_we_and_candump_read_the_same_of_cangen(self):
        for options in ([], ["-e"], ["-R"], ["-f"], ["-f", "-b", "-E"], ["-m"]):
            with self.subTest(options), candump("vcan0") as peer:
                reader = Reader("can:vcan0", 200)
                run("cangen", "vcan0", "-g", "0", "-p", "10", "-n", "200", "-I", "r", "-L", "r", "-D", "r", *options)
                ours = reader.frames()
                self.assertEqual(ours, peer.frames(200))
                self.assertGreater(len(set(ours)), 100)

    def test_we_read_what_canplayer_plays_of_our_log(self):
        texts = random_frames(300, 5)
        with tempfile.NamedTemporaryFile("w", suffix=".log") as log:
            log.write(as_log(texts, "recorded0"))
            log.flush()
            reader = Reader("can:vcan1", len(texts))
            run("canplayer", "-t", "-g", "0", "-I", log.name, "vcan1=recorded0")
            self.assertEqual(reader.frames(), texts)

    def test_canplayer_plays_the_log_that_we_record(self):
        texts = random_frames(200, 6)
        recorder = subprocess.Popen([os.environ["BUS_LINES"], "dump", "can:vcan0", "200"], stdout=subprocess.PIPE,
                                    stderr=subprocess.PIPE, text=True)
        self.assertEqual(recorder.stderr.readline(), "ready\n")
        send("can:vcan0", texts)
        recorded, _ = recorder.communicate(timeout=PATIENCE_S)
        with tempfile.NamedTemporaryFile("w", suffix=".log") as log:
            log.write(recorded)
            log.flush()
            reader = Reader("can:vcan1", len(texts))
            run("canplayer", "-I", log.name, "vcan1=vcan0")
            self.assertEqual(reader.frames(), texts)

    def test_we_read_what_cangw_makes_of_our_frames(self):
        self.addCleanup(run, "cangw", "-F")
        run("cangw", "-A", "-s", "vcan0", "-d", "vcan1", "-e", "-f", "100:7FF", "-m", "SET:D:0.0.1122334455667788")
        run("cangw", "-A", "-s", "vcan0", "-d", "vcan1", "-e", "-f", "200:7FF", "-m", "XOR:IL:1.3.0000000000000000")
        run("cangw", "-A", "-X", "-s", "vcan0", "-d", "vcan1", "-e", "-f", "300:7FF", "-M",
            "SET:D:0.0.0." + "A5" * 64)
        reader = Reader("can:vcan1", 4)
        send("can:vcan0", ["100#0000000000000000", "100#00", "400#00", "200#0102030405",
                           "300##1" + "00" * 64])
        self.assertEqual(reader.frames(),
                         ["100#1122334455667788", "100#11", "201#010203040500", "300##1" + "A5" * 64])

    def test_python_can_and_we_understand_each_other(self):
        exchange_with_python_can(self, "can:vcan0", random_frames(300, 7), interface="socketcan", channel="vcan0",
                                 fd=True)

    def test_python_can_reads_our_error_frames(self):
        exchange_with_python_can(self, "can:vcan1", random_frames(50, 8, ["error"]), interface="socketcan",
                                 channel="vcan1")


if __name__ == "__main__":
    unittest.main(verbosity=2)
