#!/usr/bin/python3
"""`faultline play` and `faultline diagnose`: a recorded run, played to live LCM or to a bus, is diagnosed alike.

In a network namespace of its own.
"""
import contextlib
import json
import os
import signal
import socket
import struct
import subprocess
import threading
import time
import unittest

from faultline_program import (Event, FolderTest, decode, decode_all, finish, program, read_log, reassemble_parts,
                               wait_for)
from multicast_namespace import URL, enter_namespace

BUS = "udp:239.74.163.2:43113"
OTHER_BUS = "udp:239.74.163.3:43113"
RESULTS = ["FAULTLINE_SAMPLE", "FAULTLINE_RESIDUAL", "FAULTLINE_DIAGNOSIS", "FAULTLINE_ESTIMATE"]
SO_RCVBUFFORCE = 33  # asm-generic/socket.h
FRAMES_PER_CYCLE = 5  # SYNC, two messages of sensors, two of commands


def write_log(file, events):
    with open(file, "wb") as out:
        for number, event in enumerate(events):
            channel = event.channel.encode()
            out.write(bytes.fromhex("EDA1DA01") + struct.pack(">qqii", number, event.utime, len(channel),
                                                              len(event.data)) + channel + event.data)


def without_time(messages):
    """What messages say, but for their times and numbers."""
    return [{name: value for name, value in message.items() if name not in ("utime", "sequence")}
            for message in messages]


def frames_of(messages):
    return [frame for message in messages["FAULTLINE_CAN"] for frame in message["frames"]]


class LcmReceiver:
    """Takes LCM messages of one datagram off a multicast group, on a thread; lcm-logger drops some under load."""

    def __init__(self, group, port):
        self.messages = []
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        for option in (SO_RCVBUFFORCE, socket.SO_RCVBUF):
            try:
                self.socket.setsockopt(socket.SOL_SOCKET, option, 8 << 20)
                break
            except PermissionError:
                continue
        self.socket.bind((group, port))
        self.socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP,
                               socket.inet_aton(group) + socket.inet_aton("127.0.0.1"))
        self.socket.settimeout(0.05)
        self.must_stop = False
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self):
        while not self.must_stop:
            try:
                datagram = self.socket.recv(65536)
            except TimeoutError:
                continue
            channel, _, data = datagram[8:].partition(b"\0")
            message = (channel.decode(errors="replace"), data)
            is_repeated_run = message[0] == "FAULTLINE_RUN" and message in self.messages
            if message[0].startswith("FAULTLINE_") and not is_repeated_run:  # liblcm sends itself a probe
                self.messages.append(message)

    def close(self):
        self.must_stop = True
        self.thread.join()
        self.socket.close()


class Playback(FolderTest):
    def setUp(self):
        super().setUp()
        text = self.folder.read("demo.toml").decode()
        text = text[:text.index("[[expect]]")].replace("duration_s = 10.0", "duration_s = 3.0")
        self.folder.write("short.toml", text.replace("at_s   = 4.0", "at_s   = 2.0"))
        self.run_ok("run", "short.toml", "--log", "own.lcm")
        self.own = read_log(self.folder.file("own.lcm"))[0]

    def diagnose(self, *arguments, source="lcm:" + URL):
        """Starts a diagnosis and waits until it listens."""
        err = open(self.folder.file("diagnose.err"), "w+b")
        self.addCleanup(err.close)
        process = self.folder.start("diagnose", "--from", source, *arguments, stderr=err)
        self.addCleanup(lambda: process.poll() is None and (process.kill(), process.communicate()))
        if source.startswith("lcm:"):
            wait_for(lambda: b"waiting for FAULTLINE_RUN" in self.folder.read("diagnose.err"))
        else:
            wait_for(lambda: self.listens_at(int(source.rpartition(":")[2]), process.pid))
        return process

    @staticmethod
    def listens_at(port, pid):
        """The kernel has bound a UDP socket of the process to the port."""
        with open("/proc/net/udp", encoding="ascii") as file:
            inodes = {line.split()[9] for line in file.readlines()[1:]
                      if int(line.split()[1].partition(":")[2], 16) == port}
        folder = f"/proc/{pid}/fd"
        links = set()
        for fd in os.listdir(folder):
            with contextlib.suppress(FileNotFoundError):  # closed meanwhile
                links.add(os.readlink(f"{folder}/{fd}"))
        return any(f"socket:[{inode}]" in links for inode in inodes)

    def told(self):
        return self.folder.read("diagnose.err").decode()

    def log_of(self, file="out.lcm"):
        events, rest = read_log(self.folder.file(file))
        self.assertEqual(rest, 0)
        return decode_all(events)

    def assert_equal_results(self, found, own=None, channels=RESULTS):
        own = own or decode_all(self.own)
        for channel in channels:
            self.assertTrue(own[channel], channel)
            self.assertEqual(len(found[channel]), len(own[channel]), channel)
            # NaN is equal to itself here: its text is.
            self.assertTrue(repr(without_time(found[channel])) == repr(without_time(own[channel])),
                            f"{channel}: a message differs")

    def change(self, change_can):
        """A log with other CAN messages: change_can(list of events) returns the new list."""
        runs = [event for event in self.own if event.channel == "FAULTLINE_RUN"]
        frames = [event for event in self.own if event.channel == "FAULTLINE_CAN"]
        write_log(self.folder.file("changed.lcm"), change_can(runs, frames))

    # --------------------------------------------------------------------------------------- over LCM

    def test_lcm_logplayer_drives_a_diagnosis_to_the_bit(self):
        process = self.diagnose("--idle", "1.5", "--log", "out.lcm", "--json", "result.json")
        subprocess.run(["lcm-logplayer", "-l", URL, "own.lcm"], cwd=self.folder.path, check=True, timeout=30,
                       stdout=subprocess.DEVNULL)
        self.assert_code(0, finish(process))
        found = self.log_of()
        self.assert_equal_results(found)
        self.assertEqual(frames_of(found), frames_of(decode_all(self.own)))
        self.assertEqual(reassemble_parts(found["FAULTLINE_RUN"]),
                         reassemble_parts(decode_all(self.own)["FAULTLINE_RUN"]))
        result = json.loads(self.folder.read("result.json"))
        self.assertEqual((result["samples"], result["lcm"]["lost_messages"], len(result["runs"])), (301, 0, 1))
        self.assertEqual(result["runs"][0]["verdicts"][-1]["faults"], ["u2", "u3"])
        self.assertTrue(found["FAULTLINE_STATS"][-1]["is_final"])

    def test_play_drives_a_diagnosis_to_the_bit(self):
        process = self.diagnose("--idle", "1.5", "--log", "out.lcm")
        played = json.loads(self.run_ok("play", "own.lcm", "--bus", "lcm:" + URL, "--json", "-").out)
        answer = finish(process)
        self.assert_code(0, answer)
        self.assert_equal_results(self.log_of())
        self.assertEqual((played["sent"], played["refused"], played["passes"]), (len(self.own), 0, 1))
        self.assertEqual(played["timing_error"]["values"], len(self.own))
        self.assertRegex(answer.out, r"(?m)^ +2\.\d\d s  isolated u2, u3; u2 = ")

    def test_results_are_published_live(self):
        receiver = LcmReceiver("239.255.76.68", 7668)
        self.addCleanup(receiver.close)
        process = self.diagnose("--idle", "1.5", "--log", "out.lcm", "--lcm", "udpm://239.255.76.68:7668?ttl=0")
        self.run_ok("play", "own.lcm", "--bus", "lcm:" + URL)
        self.assert_code(0, finish(process))
        logged = [(event.channel, event.data) for event in read_log(self.folder.file("out.lcm"))[0]]
        wait_for(lambda: receiver.messages[-1:] == logged[-1:])
        self.assertTrue(receiver.messages == logged, "what was published differs from what was logged")

    def test_a_lost_message_is_told(self):
        lost = {}

        def drop(runs, frames):
            lost.update(decode(frames.pop(1)))
            return runs + frames

        self.change(drop)
        process = self.diagnose("--idle", "1.5", "--log", "out.lcm", "--json", "result.json")
        self.run_ok("play", "changed.lcm", "--bus", "lcm:" + URL)
        self.assert_code(0, finish(process))
        counters = json.loads(self.folder.read("result.json"))["lcm"]
        self.assertEqual((counters["lost_messages"], counters["missing_frames"]), (1, lost["frame_count"]))
        self.assertIn(f"1 messages lost on lcm:{URL} with {lost['frame_count']} frames", self.told())
        found = self.log_of()
        self.assertIn(f"{lost['frame_count']} frames are missing before number "
                      f"{lost['first_frame'] + lost['frame_count']}",
                      [event["text"] for event in found["FAULTLINE_EVENT"]])
        self.assertEqual(found["FAULTLINE_STATS"][-1]["frames_dropped"], lost["frame_count"])
        numbers = [n for message in found["FAULTLINE_CAN"]
                   for n in range(message["first_frame"], message["first_frame"] + message["frame_count"])]
        missing = range(lost["first_frame"], lost["first_frame"] + lost["frame_count"])
        self.assertEqual(sorted({*range(numbers[-1] + 1)} - {*numbers}), list(missing))

    def test_a_lost_end_is_told(self):
        last = [event for event in self.own if event.channel == "FAULTLINE_CAN"][-1]
        write_log(self.folder.file("changed.lcm"), [event for event in self.own if event is not last])
        process = self.diagnose("--idle", "1.5", "--log", "out.lcm", "--json", "result.json")
        self.run_ok("play", "changed.lcm", "--bus", "lcm:" + URL)
        self.assert_code(0, finish(process))
        self.assertEqual(json.loads(self.folder.read("result.json"))["lcm"]["lost_messages"], 1)
        self.assertIn(f"1 messages lost on lcm:{URL} at the end of the run", self.told())

    def test_swapped_messages_are_put_in_order(self):
        def swap(runs, frames):
            frames[2], frames[3] = frames[3]._replace(utime=frames[2].utime), frames[2]
            return runs + frames

        self.change(swap)
        process = self.diagnose("--idle", "1.5", "--log", "out.lcm")
        self.run_ok("play", "changed.lcm", "--bus", "lcm:" + URL)
        self.assert_code(0, finish(process))
        self.assert_equal_results(self.log_of())

    def test_frames_that_come_before_the_run_are_kept(self):
        self.change(lambda runs, frames: frames[:-1] + [run._replace(utime=frames[-2].utime) for run in runs] +
                    frames[-1:])
        process = self.diagnose("--idle", "1.5", "--log", "out.lcm")
        self.run_ok("play", "changed.lcm", "--bus", "lcm:" + URL)
        self.assert_code(0, finish(process))
        self.assert_equal_results(self.log_of())

    def test_each_pass_of_a_loop_is_a_diagnosis_of_its_own(self):
        process = self.diagnose("--idle", "1.5", "--log", "out.lcm", "--json", "result.json")
        played = json.loads(self.run_ok("play", "own.lcm", "--bus", "lcm:" + URL, "--loop", "2", "--json", "-",
                                        "--channel", "FAULTLINE_RUN", "--channel", "FAULTLINE_CAN").out)
        self.assert_code(0, finish(process))
        self.assertEqual(played["passes"], 2)
        for file in ("out.lcm", "out-2.lcm"):
            self.assert_equal_results(self.log_of(file))
        result = json.loads(self.folder.read("result.json"))
        self.assertEqual([run["log"] for run in result["runs"]], ["out.lcm", "out-2.lcm"])
        self.assertEqual((result["lcm"]["restarts"], result["lcm"]["lost_messages"]), (1, 0))

    def test_another_run_starts_over(self):
        self.run_ok("run", "short.toml", "--log", "second.lcm")
        process = self.diagnose("--idle", "1.5", "--log", "out.lcm")
        for file in ("own.lcm", "second.lcm"):
            self.run_ok("play", file, "--bus", "lcm:" + URL)
        self.assert_code(0, finish(process))
        self.assertIn("another run", self.told())
        self.assert_equal_results(self.log_of("out.lcm"))
        second = decode_all(read_log(self.folder.file("second.lcm"))[0])
        self.assert_equal_results(self.log_of("out-2.lcm"), second)

    def test_listening_that_begins_in_the_middle_says_so(self):
        process = self.diagnose("--idle", "1.5", "--log", "out.lcm")
        self.run_ok("play", "own.lcm", "--bus", "lcm:" + URL, "--from", "1", "--to", "2.5")
        self.assert_code(0, finish(process))
        found = self.log_of()
        first = found["FAULTLINE_CAN"][0]["first_frame"]
        self.assertGreater(first, 0)
        self.assertIn(f"listening began at frame {first}: nothing is known of those before",
                      [event["text"] for event in found["FAULTLINE_EVENT"]])
        self.assertGreater(len(found["FAULTLINE_SAMPLE"]), 50)

    def test_a_signal_ends_listening_with_what_was_seen(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            process = self.diagnose("--log", "out.lcm")
            self.run_ok("play", "own.lcm", "--bus", "lcm:" + URL, "--to", "1")
            wait_for(lambda: len(read_log(self.folder.file("out.lcm"))[0]) > 50)
            process.send_signal(number)
            self.assert_code(0, finish(process))
            found = self.log_of()
            self.assertTrue(found["FAULTLINE_STATS"][-1]["is_final"])

    def test_nothing_to_diagnose_is_a_no(self):
        process = self.diagnose("--for", "0.3")
        answer = finish(process)
        self.assert_code(1, answer)
        self.assertIn("no diagnosis", self.told())

    def test_rubbish_on_our_channels_is_counted(self):
        rubbish = [Event(0, self.own[0].utime, channel, data) for channel in ("FAULTLINE_RUN", "FAULTLINE_CAN")
                   for data in (b"", b"x" * 7, b"\xff" * 200, self.own[0].data[:-1], self.own[-1].data)]
        write_log(self.folder.file("rubbish.lcm"), rubbish)
        process = self.diagnose("--idle", "1.5", "--json", "result.json")
        self.run_ok("play", "rubbish.lcm", "--bus", "lcm:" + URL)
        self.run_ok("play", "own.lcm", "--bus", "lcm:" + URL)
        self.assert_code(0, finish(process))
        result = json.loads(self.folder.read("result.json"))
        self.assertEqual((result["lcm"]["undecodable"], result["samples"]), (len(rubbish), 301))

    # --------------------------------------------------------------------------------------- over a bus

    def play_to_bus(self, log, *arguments):
        return json.loads(self.run_ok("play", log, "--bus", BUS, "--json", "-", *arguments).out)

    def test_a_bus_is_diagnosed_alike(self):
        self.run_ok("design", "bank.toml", "-o", "pairs.bank.json")
        process = self.diagnose("--bank", "pairs.bank.json", "--dbc", "bench.dbc", "--idle", "1.5", "--log", "out.lcm",
                                source=BUS)
        played = self.play_to_bus("own.lcm")
        answer = finish(process)
        self.assert_code(0, answer)
        found, own = self.log_of(), decode_all(self.own)
        self.assert_equal_results(found)
        keys = ("id", "flags", "length", "data")
        self.assertEqual([[frame[key] for key in keys] for frame in frames_of(found)],
                         [[frame[key] for key in keys] for frame in frames_of(own)])
        self.assertEqual(played["sent"], 301 * FRAMES_PER_CYCLE)
        self.assertEqual(set(reassemble_parts(found["FAULTLINE_RUN"])), {"bank", "dbc"})

    def test_a_log_without_scenario_drives_a_diagnosis_again(self):
        self.run_ok("design", "bank.toml", "-o", "pairs.bank.json")
        process = self.diagnose("--bank", "pairs.bank.json", "--dbc", "bench.dbc", "--idle", "1.5", "--log", "first.lcm",
                                source=BUS)
        self.play_to_bus("own.lcm")
        self.assert_code(0, finish(process))
        process = self.diagnose("--idle", "1.5", "--log", "out.lcm")
        self.run_ok("play", "first.lcm", "--bus", "lcm:" + URL)
        self.assert_code(0, finish(process))
        self.assert_equal_results(self.log_of())

    def dumped(self, log, count, *arguments):
        """What a listener at the bus gets of a playback: candump's texts of the frames."""
        process = self.folder.start("can", "dump", BUS, "--format", "log", "--count", str(count))
        self.addCleanup(lambda: process.poll() is None and (process.kill(), process.communicate()))
        wait_for(lambda: self.listens_at(43113, process.pid))
        played = self.play_to_bus(log, *arguments)
        answer = finish(process)
        self.assert_code(0, answer)
        return played, [line.split()[2] for line in answer.out.splitlines()]

    def test_stamps_that_go_backwards_are_sent_at_once_and_counted(self):
        lines = ["(100.000000) vcan0 101#01", "(100.300000) vcan0 102#02", "(100.200000) vcan0 103#03",
                 "(100.400000) vcan0 104#04", "(50.000000) vcan0 105#05", "(50.100000) vcan0 106#06"]
        self.folder.write("back.log", "\n".join(lines) + "\n")
        played, frames = self.dumped("back.log", 6)
        self.assertEqual(frames, [line.split()[2] for line in lines])
        self.assertEqual(played["backwards"], 2)
        # Behind the clock that was set back the distances count: 0.4 s and 0.1 s in all.
        self.assertGreaterEqual(played["wall_s"], 0.5)

    def test_a_part_of_a_candump_log(self):
        self.folder.write("ten.log", "".join(f"({100 + n}.000000) vcan0 10{n}#\n" for n in range(10)))
        played, frames = self.dumped("ten.log", 3, "--from", "2", "--to", "5", "--speed", "20")
        self.assertEqual(frames, ["102#", "103#", "104#"])
        self.assertEqual(played["sent"], 3)

    def test_a_loop_keeps_its_period(self):
        self.folder.write("two.log", "(1.0) vcan0 101#\n(1.1) vcan0 102#\n")
        played, frames = self.dumped("two.log", 6, "--loop", "3")
        self.assertEqual(frames, ["101#", "102#"] * 3)
        self.assertEqual(played["passes"], 3)
        self.assertGreaterEqual(played["wall_s"], 0.5)  # 0.1 s between any two

    def test_frames_go_to_the_bus_of_their_name(self):
        self.folder.write("two.log", "(1.0) udp1 101#\n(1.0) udp0 102#\n(1.0) udp1 103#\n")
        process = self.folder.start("can", "dump", OTHER_BUS, "--format", "log", "--count", "2")
        self.addCleanup(lambda: process.poll() is None and (process.kill(), process.communicate()))
        wait_for(lambda: self.listens_at(43113, process.pid))
        self.run_ok("play", "two.log", "--bus", f"{BUS},{OTHER_BUS}")
        answer = finish(process)
        self.assertEqual([line.split()[2] for line in answer.out.splitlines()], ["101#", "103#"])

    def test_error_frames_are_not_sent(self):
        self.folder.write("error.log", "(1.0) vcan0 101#\n(1.0) vcan0 20000040#0000000000000000\n(1.0) vcan0 102#\n")
        played, frames = self.dumped("error.log", 2)
        self.assertEqual((frames, played["sent"], played["error_frames"]), (["101#", "102#"], 2, 1))

    def test_a_candump_log_becomes_messages(self):
        self.run_ok("can", "convert", "own.lcm", "own.log")
        process = self.folder.start("diagnose", "short.toml", "--from", "lcm:" + URL, "--idle", "1.5", "--log", "out.lcm",
                                    stderr=subprocess.DEVNULL)
        self.addCleanup(lambda: process.poll() is None and (process.kill(), process.communicate()))
        wait_for(lambda: self.listens_at(7667, process.pid))
        time.sleep(0.2)  # LCM joins the group before it knows what it has subscribed to, and says nothing
        self.run_ok("play", "own.log", "--bus", "lcm:" + URL)
        self.assert_code(0, finish(process))
        self.assert_equal_results(self.log_of())

    # --------------------------------------------------------------------------------------- control

    def test_steps(self):
        process = self.folder.start("play", "own.lcm", "--bus", BUS, "--step", "--json", "-", stdin=subprocess.PIPE)
        out, err = process.communicate(b"\n3\nwhat\nq\n", timeout=30)
        self.assertEqual(process.returncode, 0, err)
        self.assertEqual(json.loads(out)["sent"], 4 * FRAMES_PER_CYCLE)
        self.assertIn(b'found "what", expected Enter, a number or q', err)

    def test_stepping_without_anybody_to_ask(self):
        answer = self.folder.run("play", "own.lcm", "--bus", BUS, "--step")
        self.assert_code(2, answer)
        self.assertIn("stdin", answer.err)

    def test_an_interrupted_playback_tells_how_it_went(self):
        process = self.folder.start("play", "own.lcm", "--bus", BUS, "--loop", "--json", "result.json")
        self.addCleanup(lambda: process.poll() is None and (process.kill(), process.communicate()))
        wait_for(lambda: self.has_handler(process.pid, signal.SIGINT))
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        answer = finish(process)
        self.assert_code(130, answer)
        result = json.loads(self.folder.read("result.json"))
        self.assertTrue(result["interrupted"])
        self.assertGreater(result["timing_error"]["values"], 0)
        self.assertIn("sent - deadline", answer.out)

    @staticmethod
    def has_handler(pid, number):
        with open(f"/proc/{pid}/status", encoding="ascii") as file:
            caught = next(line for line in file if line.startswith("SigCgt:"))
        return int(caught.split()[1], 16) >> (number - 1) & 1

    def test_a_long_silence_is_kept_and_told(self):
        self.folder.write("gap.log", "(1.0) vcan0 101#\n(61.0) vcan0 102#\n")
        process = self.folder.start("play", "gap.log", "--bus", BUS)
        self.addCleanup(lambda: process.poll() is None and (process.kill(), process.communicate()))
        self.assertRegex(process.stderr.readline().decode(), r"0.00 / 60.00 s, the next in (60|59) s")
        process.send_signal(signal.SIGINT)
        self.assert_code(130, finish(process))

    # --------------------------------------------------------------------------------------- bad input

    def refused(self, code, *arguments):
        answer = self.folder.run(*arguments)
        self.assert_code(code, answer)
        return answer.err

    def test_what_play_refuses(self):
        self.folder.write("two.log", "(1.0) can0 101#\n(1.1) can1 102#\n")
        self.folder.write("one.log", "(1.0) can0 101#\n")
        write_log(self.folder.file("other.lcm"), [Event(0, 1, "POSE", b"12345678")])
        for log, arguments, text in (
                ("own.lcm", ["--from", "30"], "--from: found 30 s, expected less than 3 s, the length of own.lcm"),
                ("own.lcm", ["--from", "2", "--to", "1"], "--to: found 1 s, expected more than --from, 2 s"),
                ("own.lcm", ["--speed", "nan"], "expected a finite number"),
                ("own.lcm", ["--channel", "FAULTLINE_CAN"], "expected --bus lcm:URL"),
                ("own.lcm", ["--bus", "nowhere"], 'bus: found "nowhere", expected can:IFACE'),
                ("own.lcm", ["--bus", "lcm:udpm://10.0.0.1:7667"], "multicast group"),
                ("own.lcm", ["--bus", f"lcm:{URL}", "--channel", "FAULTLINE_CAM"], "did you mean FAULTLINE_CAN?"),
                ("one.log", ["--loop", "2"], "--loop: found only one time"),
                ("two.log", [], "two.log has frames of bus 1 (can1) too"),
                ("other.lcm", [], "found no CAN frames (FAULTLINE_CAN), expected some to play"),
                ("plant.toml", [], "found no CAN frames, expected some to play"),
                ("nosuch.lcm", [], "nosuch.lcm")):
            bus = [] if "--bus" in arguments else ["--bus", BUS]
            with self.subTest(arguments=[log, *arguments]):
                self.assertIn(text, self.refused(2, "play", log, *bus, *arguments))

    def test_what_diagnose_refuses(self):
        self.run_ok("design", "bank.toml", "-o", "pairs.bank.json")
        self.folder.write("other.dbc", self.folder.read("bench.dbc").replace(b" y2 ", b" z2 "))
        for arguments, text in (
                (["--from", "nowhere", "short.toml"], '--from: found "nowhere", expected lcm:URL, can:IFACE'),
                (["--from", BUS], "found neither SCENARIO nor --bank and --dbc"),
                (["--from", BUS, "--bank", "pairs.bank.json"], "--dbc"),
                (["--from", BUS, "--bank", "pairs.bank.json", "--dbc", "other.dbc"], "y2"),
                (["--from", BUS, "short.toml", "--for", "nan"], "expected a finite number"),
                (["--from", "lcm:memq://"], 'found "memq"'),
                (["--from", "lcm:udpm://239.255.76.67:port"], 'found "port", expected a port from 1 to 65535'),
                (["--from", "lcm:udpm://239.255.76.67:7667?tll=1"], 'found "tll=1"'),
                (["--from", "lcm:" + URL, "--lcm", "udpm://"], "the place that --from listens to")):
            with self.subTest(arguments=arguments):
                self.assertIn(text, self.refused(2, "diagnose", *arguments))

    def test_a_missing_route_comes_with_what_to_type(self):
        alone = ["unshare", "--net", program()]
        for arguments in (["diagnose", "--from", "lcm:" + URL], ["play", "own.lcm", "--bus", "lcm:" + URL]):
            answer = subprocess.run([*alone, *arguments], cwd=self.folder.path, env=self.folder.environment,
                                    capture_output=True, text=True, timeout=30, check=False)
            self.assertEqual(answer.returncode, 3, answer.stderr)
            self.assertIn("`ip link set lo up multicast on` and `ip route add 224.0.0.0/4 dev lo`", answer.stderr)


if __name__ == "__main__":
    enter_namespace(__file__)
    unittest.main()
