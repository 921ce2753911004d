"""Runs the program `faultline` as a user does, in a folder of its own, and reads the logs it writes.

FAULTLINE names the program (ctest sets it). The log reader and the decoder of messages share nothing with the program:
they follow lcm-logger's format and lcmtypes/*.lcm.
"""
import collections
import glob
import os
import re
import shutil
import signal
import struct
import subprocess
import tempfile
import time
import unittest

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
EXAMPLE = f"{ROOT}/examples/hou2015"
PATIENCE_S = 30  # for anything that must end; only a defect makes a test wait that long
# In a text given to `Folder.patch`: where a refusal must point, to the column or only to the line.
MARK, LINE_MARK = "§", "¶"

# The program must not inherit that signals are ignored, as a shell's background jobs do.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGTERM, signal.SIG_DFL)

Answer = collections.namedtuple("Answer", "code out err")
# A log of the user's, which nothing may touch: one event.
OLD_LOG = bytes.fromhex("EDA1DA01") + bytes(8) + bytes(8) + b"\0\0\0\x03\0\0\0\x03abcold"


def program():
    return os.path.abspath(os.environ["FAULTLINE"])


class Folder:
    """A folder with a copy of the example, in which the program runs with a bank cache of its own."""

    def __init__(self, cache=None):
        self.path = os.path.realpath(tempfile.mkdtemp(prefix="faultline-test."))
        for file in glob.glob(f"{EXAMPLE}/*.toml") + glob.glob(f"{EXAMPLE}/*.dbc"):
            shutil.copy(file, self.path)
        self.environment = {**os.environ, "XDG_CACHE_HOME": cache or f"{self.path}/cache"}

    def remove(self):
        shutil.rmtree(self.path)

    def file(self, name):
        return os.path.join(self.path, name)

    def read(self, name):
        with open(self.file(name), "rb") as file:
            return file.read()

    def write(self, name, content):
        with open(self.file(name), "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)

    def patch(self, name, *changes):
        """Replaces texts that stand in the file once.

        Returns "LINE:COLUMN:" of the MARK in the new text, "LINE:" of its LINE_MARK, "" if it has neither.
        """
        text = self.read(name).decode()
        for old, new in changes:
            assert text.count(old) == 1, f"{name}: {text.count(old)} times {old!r}"
            text = text.replace(old, new)
        before, mark, after = text.partition(LINE_MARK if LINE_MARK in text else MARK)
        self.write(name, before + after)
        line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
        return {"": "", LINE_MARK: f"{line}:", MARK: f"{line}:{column}:"}[mark]

    def start(self, *arguments, **options):
        options = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
        return subprocess.Popen([program(), *arguments], cwd=self.path, env=self.environment, **options)

    def run(self, *arguments, patience_s=PATIENCE_S, **options):
        process = self.start(*arguments, **options)
        return finish(process, patience_s)

    def logs(self):
        return sorted(glob.glob(f"{self.path}/**/*.lcm", recursive=True))


def finish(process, patience_s=PATIENCE_S):
    """Waits for a process; kills it when it does not end."""
    try:
        out, err = process.communicate(timeout=patience_s)
    except subprocess.TimeoutExpired:
        process.kill()
        out, err = process.communicate()
        raise AssertionError(f"{process.args} did not end within {patience_s} s; stderr: {err!r}") from None
    return Answer(process.returncode, *((text or b"").decode(errors="replace") for text in (out, err)))


def without_comments(text):
    """A TOML file's text without the lines that are comments."""
    return "\n".join(line for line in text.splitlines() if not line.lstrip().startswith("#")) + "\n"


def wait_for(condition, patience_s=PATIENCE_S, period_s=0.01):
    deadline = time.monotonic() + patience_s
    while not (result := condition()):
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {patience_s} s in vain")
        time.sleep(period_s)
    return result


class FolderTest(unittest.TestCase):
    """A test with a fresh `Folder`. Banks are designed once for all tests of a class."""

    maxDiff = 4000

    @classmethod
    def setUpClass(cls):
        cls.cache = tempfile.mkdtemp(prefix="faultline-test-cache.")

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.cache)

    def setUp(self):
        self.folder = Folder(self.cache)
        self.addCleanup(self.folder.remove)

    def assert_code(self, expected, answer):
        self.assertEqual(answer.code, expected, f"\nstdout: {answer.out[-2000:]}\nstderr: {answer.err[-2000:]}")

    def run_ok(self, *arguments, **options):
        answer = self.folder.run(*arguments, **options)
        self.assert_code(0, answer)
        return answer


# ------------------------------------------------------------------------------------------ LCM logs

Event = collections.namedtuple("Event", "number utime channel data")

_MAGIC = bytes.fromhex("EDA1DA01")
_HEADER = struct.Struct(">4sqqii")


def parse_log(data):
    """Returns the events of an LCM log and the number of bytes behind the last whole one."""
    events, at = [], 0
    while at + _HEADER.size <= len(data):
        magic, number, utime, channel_length, data_length = _HEADER.unpack_from(data, at)
        if magic != _MAGIC or channel_length < 1 or data_length < 0:
            raise ValueError(f"no LCM event at byte {at}")
        end = at + _HEADER.size + channel_length + data_length
        if end > len(data):
            break
        name_end = at + _HEADER.size + channel_length
        events.append(Event(number, utime, data[at + _HEADER.size:name_end].decode(), data[name_end:end]))
        at = end
    return events, len(data) - at


def read_log(file):
    with open(file, "rb") as stream:
        return parse_log(stream.read())


# ------------------------------------------------------------------------------------------ messages

_PRIMITIVES = {"int8_t": "b", "byte": "B", "boolean": "?", "int16_t": "h", "int32_t": "i", "int64_t": "q",
               "float": "f", "double": "d"}
_MEMBER = re.compile(r"(\w+) (\w+)(?:\[(\w+)\])?")


def _read_types():
    """{struct: [(type, member, name of the count or None)]} of lcmtypes/*.lcm."""
    types = {}
    for file in glob.glob(f"{ROOT}/lcmtypes/*.lcm"):
        with open(file) as stream:
            text = re.sub(r"//[^\n]*", "", stream.read())
        name, body = re.search(r"struct (\w+)\s*\{(.*)\}", text, re.DOTALL).groups()
        members = [" ".join(part.split()) for part in body.split(";")]
        types[name] = [_MEMBER.fullmatch(member).groups() for member in members
                       if member and not member.startswith("const ")]
    return types


_TYPES = _read_types()


def _decode_value(kind, data, at):
    if kind == "string":
        (length,) = struct.unpack_from(">i", data, at)
        end = at + 4 + length
        if length < 1 or end > len(data) or data[end - 1] != 0:
            raise ValueError(f"no string at byte {at}")
        return data[at + 4:end - 1].decode(), end
    if kind in _PRIMITIVES:
        layout = ">" + _PRIMITIVES[kind]
        return struct.unpack_from(layout, data, at)[0], at + struct.calcsize(layout)
    return _decode_members(kind, data, at)


def _decode_members(kind, data, at):
    values = {}
    for member_kind, name, count_name in _TYPES[kind]:
        if count_name is None:
            values[name], at = _decode_value(member_kind, data, at)
            continue
        count = values[count_name]
        if count < 0:
            raise ValueError(f"{count} of {kind}.{name}")
        if member_kind in _PRIMITIVES:
            layout = f">{count}{_PRIMITIVES[member_kind]}"
            values[name] = list(struct.unpack_from(layout, data, at))
            at += struct.calcsize(layout)
            continue
        values[name] = []
        for _ in range(count):
            value, at = _decode_value(member_kind, data, at)
            values[name].append(value)
    return values, at


def decode(event):
    """The message of an event on one of our channels: FAULTLINE_CAN is a can_t. Every byte must be used."""
    kind = event.channel.removeprefix("FAULTLINE_").lower() + "_t"
    values, end = _decode_members(kind, event.data, 8)  # behind the fingerprint
    if end != len(event.data):
        raise ValueError(f"{len(event.data) - end} bytes behind a {kind}")
    return values


def decode_all(events):
    """{channel: [message]}, in order."""
    messages = collections.defaultdict(list)
    for event in events:
        messages[event.channel].append(decode(event))
    return messages


def reassemble_parts(runs):
    """{part: bytes} from RUN messages."""
    chunks = collections.defaultdict(dict)
    counts = {}
    for run in runs:
        chunks[run["part"]][run["chunk"]] = bytes(run["data"])
        counts[run["part"]] = run["chunk_count"]
    return {part: b"".join(found[i] for i in range(counts[part])) for part, found in chunks.items()}
