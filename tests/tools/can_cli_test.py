#!/usr/bin/python3
"""`faultline can` and `faultline decode` as a user meets them, on files: logs, DBC files, bad input.

What is on a bus, can_bus_test.py shows. Expected values are exact rationals of the DBC's decimals.
"""
import collections
import csv
import fractions
import json
import os
import random
import re
import signal
import time
import unittest

from faultline_program import FolderTest, finish, parse_log, wait_for

DBC = """VERSION ""

BU_: A B

BO_ 291 Speeds: 8 A
 SG_ Left : 0|16@1+ (0.01,0) [0|655.35] "km/h" B
 SG_ Right : 16|16@1- (0.001,-32) [0|0] "km/h" B
 SG_ Gear : 39|4@0+ (1,0) [0|15] "" B
 SG_ Half : 40|16@1+ (0.5,0) [0|0] "" B

BO_ 2566844672 Odometer: 8 A
 SG_ Total : 0|64@1+ (1,0) [0|0] "mm" B

BO_ 500 Muxed: 4 A
 SG_ Selector M : 0|8@1+ (1,0) [0|0] "" B
 SG_ One m1 : 8|16@1+ (1,0) [0|0] "" B
 SG_ Two m2 : 8|16@1- (2,1) [0|0] "" B

BO_ 600 Float: 8 A
 SG_ Value : 0|32@1- (1,0) [0|0] "" B

VAL_ 291 Gear 0 "neutral" 2 "second" ;
SIG_VALTYPE_ 600 Value : 1;
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 291 10;
"""
SPEEDS = "(1436509052.249713) vcan0 123#10270100F0000100"


def lines_of(text):
    return [json.loads(line) for line in text.splitlines()]


class CanTest(FolderTest):
    def setUp(self):
        super().setUp()
        self.folder.write("car.dbc", DBC)

    def feed(self, text, *arguments):
        """Runs the program with `text` on stdin."""
        self.folder.write("stdin.txt", text)
        with open(self.folder.file("stdin.txt"), "rb") as stdin:
            return self.folder.run(*arguments, stdin=stdin)

    def decode(self, text, *arguments):
        answer = self.feed(text, "decode", "--dbc", "car.dbc", *arguments)
        self.assert_code(0, answer)
        return lines_of(answer.out)


class Decode(CanTest):
    def test_one_object_per_frame(self):
        (frame,) = self.decode(SPEEDS + "\n")
        self.assertEqual(list(frame), ["time", "bus", "id", "extended", "message", "signals"])
        self.assertEqual(frame, {"time": 1436509052.249713, "bus": "vcan0", "id": 0x123, "extended": False,
                                 "message": "Speeds",
                                 "signals": {"Left": 100.0, "Right": -31.999, "Gear": 15, "Half": 128}})

    def test_values_are_written_as_people_would(self):
        text = "".join(f"(1.0) c 123#{raw.to_bytes(2, 'little').hex()}{raw.to_bytes(2, 'little').hex()}\n"
                       for raw in range(0, 32768, 7))
        answer = self.feed(text, "decode", "--dbc", "car.dbc")
        for raw, line in zip(range(0, 32768, 7), answer.out.splitlines(), strict=True):
            left, right = re.search(r'"Left":([^,}]*),"Right":([^,}]*)', line).groups()
            self.assertEqual((left, right), (f"{raw / 100:.10g}", f"{(raw - 32000) / 1000:.10g}"))

    def test_the_long_form_says_the_same(self):
        short = self.feed(SPEEDS, "decode", "--dbc", "car.dbc")
        long = self.feed(SPEEDS, "can", "decode", "--dbc", "car.dbc", "-")
        self.assertEqual(short, long)

    def test_values_are_those_of_exact_rationals(self):
        chance = random.Random(4)
        exact = {"Left": (16, False, fractions.Fraction("0.01"), 0),
                 "Right": (16, True, fractions.Fraction("0.001"), -32),
                 "Half": (16, False, fractions.Fraction("0.5"), 0)}
        payloads = [bytes(chance.randrange(256) for _ in range(8)) for _ in range(2000)]
        payloads += [(0).to_bytes(2, "little") + raw.to_bytes(2, "little", signed=True) + bytes(4)
                     for raw in (31999, 32000, 32001)]
        text = "".join(f"(0.{n:06}) c 123#{payload.hex()}\n" for n, payload in enumerate(payloads))
        for frame, payload in zip(self.decode(text), payloads, strict=True):
            for (name, (bits, signed, factor, offset)), at in zip(exact.items(), (0, 2, 5), strict=True):
                raw = int.from_bytes(payload[at:at + bits // 8], "little", signed=signed)
                want = raw * factor + offset
                found = fractions.Fraction(frame["signals"][name])
                self.assertLessEqual(abs(found - want), abs(want) * fractions.Fraction(1, 10 ** 12), (name, raw))

    def test_all_64_bits_of_a_whole_number(self):
        (frame,) = self.decode("(1.0) can1 18FEF100#FEFFFFFFFFFFFFFF\n")
        self.assertEqual((frame["id"], frame["extended"]), (0x18FEF100, True))
        self.assertEqual(frame["signals"], {"Total": 2 ** 64 - 2})

    def test_multiplexed_signals_are_there_when_selected(self):
        text = "(1.0) c 1F4#01FFFF00\n(1.0) c 1F4#02FFFF00\n(1.0) c 1F4#03FFFF00\n"
        self.assertEqual([frame["signals"] for frame in self.decode(text)],
                         [{"Selector": 1, "One": 65535}, {"Selector": 2, "Two": -1}, {"Selector": 3}])

    def test_short_payloads_and_floats_that_are_no_number(self):
        first, second = self.decode("(1.0) c 123#1027\n(1.0) c 258#0000C07F00000000\n")
        self.assertEqual((first["signals"], first["beyond_payload"]), ({"Left": 100}, ["Right", "Gear", "Half"]))
        self.assertEqual((second["signals"], second["not_a_number"]), ({}, ["Value"]))

    def test_unknown_remote_error_and_fd_frames(self):
        text = "(1.0) c 7FF#00\n(1.0) c 123#R\n(1.0) c 20000040#0000000000000000\n(1.0) c 123##3" + "00" * 12 + "\n"
        unknown, remote, error, fd = self.decode(text)
        self.assertEqual((unknown["message"], unknown["signals"]), (None, {}))
        self.assertEqual((remote["message"], remote["remote"], remote["signals"]), ("Speeds", True, {}))
        self.assertEqual((error["message"], error["error"]), (None, True))
        self.assertEqual((fd["fd"], fd["signals"]["Right"]), (True, -32))

    def test_what_is_no_frame_is_told_and_passed_over(self):
        answer = self.feed(f"# a comment\n\n{SPEEDS}\n(1.0) vcan0 12G#00\n{SPEEDS}\r\n", "decode", "--dbc", "car.dbc")
        self.assert_code(2, answer)
        self.assertEqual(len(lines_of(answer.out)), 2)
        self.assertRegex(answer.err, r"^faultline: stdin:4:\d+: found \S.*, expected .+\n$")

    def test_many_bad_lines_are_counted(self):
        answer = self.feed(f"{SPEEDS}\n" + "nonsense\n" * 1000, "decode", "--dbc", "car.dbc")
        self.assert_code(2, answer)
        self.assertEqual(len(answer.err.splitlines()), 21)
        self.assertIn("980 more", answer.err)

    def test_lines_of_any_length(self):
        answer = self.feed(f"{'x' * 3000000}\n{SPEEDS}\n(1.0) c 123#{'00' * 1500000}\n{SPEEDS}", "decode",
                           "--dbc", "car.dbc")
        self.assert_code(2, answer)
        self.assertEqual(len(lines_of(answer.out)), 2)
        self.assertEqual(re.findall(r"stdin:(\d+):", answer.err), ["1", "3"])

    def test_a_file_that_is_no_log_is_refused(self):
        self.folder.write("binary", bytes(range(256)) * 100)
        self.folder.write("text", "lorem ipsum\n" * 1000)
        for name in ("binary", "text"):
            with self.subTest(name):
                answer = self.folder.run("decode", "--dbc", "car.dbc", name)
                self.assert_code(2, answer)
                self.assertIn(name, answer.err)
                self.assertEqual(answer.out, "")

    def test_filters(self):
        text = "".join(f"(1.0) c {frame_id}#00\n" for frame_id in ("123", "1F4", "258", "18FEF100", "00000123"))
        cases = {"123": ["123"], "100-1FF": ["123", "1F4"], "100/700": ["123", "1F4"], "18FEF100": ["18FEF100"],
                 "00000123": ["00000123"], "Mux*": ["1F4"], "*o*": ["18FEF100", "258"][::-1]}
        for filter_text, wanted in cases.items():
            with self.subTest(filter_text):
                frames = self.decode(text, "--filter", filter_text)
                found = [f"{frame['id']:0{8 if frame['extended'] else 3}X}" for frame in frames]
                self.assertEqual(found, wanted)

    def test_bad_filters_are_refused(self):
        for filter_text in ("Nothing*", "12345678901", "1FFFFFFFF", "-", "100-"):
            with self.subTest(filter_text):
                answer = self.feed(SPEEDS, "decode", "--dbc", "car.dbc", "--filter", filter_text)
                self.assert_code(2, answer)
                self.assertIn("expected", answer.err)

    def test_frames_from_a_pipe_come_out_at_once(self):
        reading, writing = os.pipe()
        process = self.folder.start("decode", "--dbc", "car.dbc", stdin=reading)
        os.close(reading)
        try:
            os.write(writing, SPEEDS.encode() + b"\n")
            self.assertIn(b'"Speeds"', process.stdout.readline())  # while the pipe is still open
        finally:
            os.close(writing)
            self.assert_code(0, finish(process))

    def test_a_reader_that_leaves_is_no_crash(self):
        self.folder.write("long.log", f"{SPEEDS}\n" * 100000)
        process = self.folder.start("decode", "--dbc", "car.dbc", "long.log")
        process.stdout.readline()
        process.stdout.close()
        process.wait(timeout=30)
        self.assertEqual(process.returncode, 3)
        process.stderr.close()

    def test_parameter_groups_are_found_under_other_addresses(self):
        self.folder.write("car.dbc", DBC.replace('BA_ "Gen', 'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","J1939PG";\n'
                                                 'BA_ "VFrameFormat" BO_ 2566844672 1;\nBA_ "Gen', 1))
        text = "(1.0) c 0CFEF142#0100000000000000\n(1.0) c 0CFEF242#0100000000000000\n"
        self.assertEqual([frame["message"] for frame in self.decode(text)], ["Odometer", None])


class DbcCheck(CanTest):
    def check(self, text, code=0):
        self.folder.write("x.dbc", text)
        answer = self.folder.run("can", "dbc", "check", "x.dbc", "--json", "-")
        self.assert_code(code, answer)
        return json.loads(answer.out), answer.err

    def test_messages_signals_and_counts(self):
        result, text = self.check(DBC)
        self.assertEqual((result["message_count"], result["signal_count"]), (4, 9))
        speeds = result["messages"][0]
        self.assertEqual((speeds["name"], speeds["id"], speeds["length"]), ("Speeds", 291, 8))
        gear = speeds["signals"][2]
        self.assertEqual((gear["start_bit"], gear["bits"], gear["byte_order"], gear["type"]),
                         (39, 4, "big_endian", "unsigned"))
        self.assertEqual(gear["values"], {"0": "neutral", "2": "second"})
        self.assertEqual(result["messages"][2]["signals"][1]["present_if"], {"signal": "Selector", "ranges": [[1, 1]]})
        self.assertEqual(result["messages"][3]["signals"][0]["type"], "float32")
        self.assertIn("4 messages, 9 signals; 0 errors", text)

    def test_overlaps_are_listed(self):
        result, _ = self.check(DBC.replace("Half : 40|16", "Half : 38|16"))
        self.assertEqual(result["overlaps"], [{"message": "Speeds", "signals": ["Gear", "Half"]}])
        self.assertTrue(any("overlap" in warning["text"] for warning in result["warnings"]))

    def test_a_statement_that_is_not_understood_is_an_error_with_its_place(self):
        result, _ = self.check(DBC.replace(' SG_ Gear : 39|4@0+', ' SG_ Gear : 39|four@0+'), code=1)
        (error,) = [warning for warning in result["warnings"] if warning["severity"] == "error"]
        self.assertEqual(error["line"], 8)
        self.assertIn("expected", error["text"])
        self.assertEqual([signal["name"] for signal in result["messages"][0]["signals"]], ["Left", "Right", "Half"])

    def test_what_is_no_dbc_is_refused(self):
        for name, content in {"empty": "", "binary": bytes(range(256)), "prose": "It was a dark night.\n"}.items():
            with self.subTest(name):
                self.folder.write("no.dbc", content)
                answer = self.folder.run("can", "dbc", "check", "no.dbc", "--json", "-")
                self.assert_code(2, answer)
                self.assertRegex(answer.err, r"no\.dbc:\d+:\d+: found .+, expected .+")
        self.assert_code(2, self.folder.run("can", "dbc", "check", "missing.dbc"))

    def test_info_says_the_same(self):
        check = self.run_ok("can", "dbc", "check", "car.dbc", "--json", "-")
        self.assertEqual(self.run_ok("info", "car.dbc", "--json", "-").out, check.out)


class Convert(CanTest):
    def random_log(self, count=500):
        chance = random.Random(5)
        lines = []
        for n in range(count):
            bus = chance.choice(["vcan0", "can1"])
            kind = chance.choice(["123#{:016X}", "18FEF100#{:016X}", "258#{:08X}3F000000", "123##1{:016X}",
                                  "2A0#R", "2A0#", "20000040#{:016X}"])
            lines.append(f"({1600000000 + n // 10}.{n % 10 * 100000 + 17:06}) {bus} "
                         f"{kind.format(chance.getrandbits(28))}")
        return "\n".join(lines) + "\n"

    def test_candump_to_lcm_and_back(self):
        text = self.random_log()
        self.folder.write("a.log", text)
        self.run_ok("can", "convert", "a.log", "a.lcm")
        self.run_ok("can", "convert", "a.lcm", "b.log")
        self.assertEqual(self.folder.read("b.log").decode(), text)

    def test_the_lcm_log_is_one_that_others_read(self):
        self.folder.write("a.log", self.random_log())
        self.run_ok("can", "convert", "a.log", "a.lcm")
        events, rest = parse_log(self.folder.read("a.lcm"))
        self.assertEqual(rest, 0)
        self.assertEqual({event.channel for event in events}, {"FAULTLINE_CAN", "FAULTLINE_RUN"})
        info = json.loads(self.run_ok("info", "a.lcm", "--json", "-").out)
        self.assertEqual((info["undecodable"], info["channels"]["FAULTLINE_CAN"]["missing"]), (0, 0))

    def test_a_run_s_own_log_converts_to_the_frames_of_the_run(self):
        self.run_ok("run", "demo.toml", "--log", "run.lcm", "--json", "run.json")
        self.run_ok("can", "convert", "run.lcm", "run.log")
        frames = self.folder.read("run.log").decode().splitlines()
        sent = json.loads(self.folder.read("run.json"))["frames"]["received"]
        self.assertEqual(len(frames), sent)

    def test_signals_to_csv_and_back(self):
        frames = [line for line in self.random_log(300).splitlines() if re.search(" (123|18FEF100)#[0-9A-F]", line)]
        self.folder.write("a.log", "\n".join(frames) + "\n")
        self.run_ok("can", "convert", "a.log", "a.csv", "--dbc", "car.dbc")
        with open(self.folder.file("a.csv"), newline="") as file:
            rows = list(csv.DictReader(file))
        self.assertEqual(len(rows), len(frames))
        self.assertEqual(list(rows[0])[3:], ["Speeds.Left", "Speeds.Right", "Speeds.Gear", "Speeds.Half",
                                             "Odometer.Total"])
        self.run_ok("can", "convert", "a.csv", "b.log", "--dbc", "car.dbc")
        for before, after in zip(frames, self.folder.read("b.log").decode().splitlines(), strict=True):
            head, _, payload = after.rpartition("#")
            self.assertEqual(head, before.rpartition("#")[0])
            # Bits that no signal describes are zero: the low half of byte 4 and byte 7.
            known = 0xFFFFFFFFF0FFFF00 if " 123" in head else 2 ** 64 - 1
            self.assertEqual(int(payload, 16), int(before.rpartition("#")[2], 16) & known)

    def test_only_what_the_filter_lets_through(self):
        self.folder.write("a.log", self.random_log())
        answer = self.run_ok("can", "convert", "a.log", "-", "--filter", "18FEF100")
        self.assertTrue(answer.out)
        for line in answer.out.splitlines():
            self.assertTrue("18FEF100#" in line or "20000040#" in line, line)

    def test_bad_input(self):
        self.folder.write("a.log", SPEEDS + "\n")
        self.folder.write("bad.csv", "time_s,bus,message,Speeds.Nothing\n")
        cases = [(["a.log", "a.log"], "same file"), (["a.log", "a.csv"], "--dbc"),
                 (["bad.csv", "b.log"], "--dbc"), (["bad.csv", "b.log", "--dbc", "car.dbc"], "bad.csv:1:20"),
                 (["missing.log", "b.log"], "missing.log"), ([".", "b.log"], "")]
        for arguments, words in cases:
            with self.subTest(arguments):
                answer = self.folder.run("can", "convert", *arguments)
                self.assert_code(2, answer)
                self.assertIn(words, answer.err)
        self.assertEqual(self.folder.read("a.log").decode(), SPEEDS + "\n")

    def test_bad_rows_are_told_and_passed_over(self):
        self.folder.write("a.csv", "time_s,bus,message,Speeds.Left,Odometer.Total\n1.5,vcan0,Speeds,12.5,\n"
                                   "x,vcan0,Speeds,1,\n2,vcan0,Nothing,1,\n2,vcan0,Speeds,nan,\n2,vcan0,Speeds,1\n"
                                   "2,vcan0,Speeds,,1\n2.5,vcan0,Odometer,,18446744073709551614\n")
        answer = self.folder.run("can", "convert", "a.csv", "-", "--dbc", "car.dbc")
        self.assert_code(2, answer)
        self.assertEqual([re.findall(r"a\.csv:\d+:\d+", line) for line in answer.err.splitlines()[:5]],
                         [["a.csv:3:1"], ["a.csv:4:9"], ["a.csv:5:16"], ["a.csv:6:1"], ["a.csv:7:17"]])
        self.assertEqual(answer.out.splitlines()[0], "(0000000001.500000) vcan0 123#E204000000000000")
        self.assertEqual(len(answer.out.splitlines()), 2)

    def test_killed_half_way_leaves_a_log_that_can_be_read(self):
        self.folder.write("a.log", f"{SPEEDS}\n" * 400000)
        process = self.folder.start("can", "convert", "a.log", "a.lcm")
        wait_for(lambda: os.path.exists(self.folder.file("a.lcm")) and os.path.getsize(self.folder.file("a.lcm")) > 0)
        process.send_signal(signal.SIGKILL)
        finish(process)
        self.run_ok("can", "convert", "a.lcm", "b.log")
        self.assertIn(SPEEDS, self.folder.read("b.log").decode())


class Stats(CanTest):
    def stats(self, text, *arguments):
        self.folder.write("a.log", text)
        answer = self.run_ok("can", "stats", "a.log", "--dbc", "car.dbc", "--json", "-", *arguments)
        return json.loads(answer.out)

    def test_periods_against_the_dbc(self):
        # 10 ms is wanted: nine good intervals, one of 40 ms (three lost), one of 1 ms (early).
        times = [n * 10 for n in range(10)] + [130, 131]
        text = "".join(f"(1.{ms * 1000:06}) vcan0 123#00\n" for ms in times)
        result = self.stats(text)
        (speeds,) = [entry for entry in result["identifiers"] if entry["message"] == "Speeds"]
        period = speeds["period"]
        self.assertEqual((period["early"], period["late"], period["lost"]), (1, 1, 3))
        self.assertAlmostEqual(period["mean_s"], 0.131 / 11)
        self.assertEqual((period["min_s"], period["max_s"]), (0.001, 0.04))
        self.assertEqual(sum(period["jitter_counts"]), 11)
        self.assertEqual(speeds["rate_Hz"], 12 / 0.131)

    def test_load_counts_the_bits_on_the_wire(self):
        # No stuff bit can be in 0x555#; 11-bit remote frame without data: 44 bits + 3 interframe.
        text = "".join(f"({n}.000000) vcan0 2AA#R\n" for n in range(11))
        (bus,) = self.stats(text, "--bitrate", "1000")["buses"]
        bits = bus["busy_s"] * 1000 / 11
        self.assertGreaterEqual(bits, 47)
        self.assertLessEqual(bits, 47 + 8)
        self.assertAlmostEqual(bus["load"], bus["busy_s"] / 10)

    def test_several_buses_and_unknown_identifiers(self):
        result = self.stats("(1.0) vcan0 123#00\n(2.0) can7 7FF#00\n(3.0) can7 7FF#00\n")
        self.assertEqual([(bus["bus"], bus["frames"]) for bus in result["buses"]], [("vcan0", 1), ("can7", 2)])
        frames = {(entry["bus"], entry["id"]): entry["frames"] for entry in result["identifiers"] if entry["frames"]}
        self.assertEqual(frames, {("vcan0", 0x123): 1, ("can7", 0x7FF): 2})

    def test_text_for_people(self):
        self.folder.write("a.log", "".join(f"(1.{n:06}) vcan0 123#00\n" for n in range(0, 100000, 10000)))
        out = self.run_ok("can", "stats", "a.log", "--dbc", "car.dbc", "--jitter").out
        self.assertRegex(out, r"vcan0 +123 +Speeds +10 ")
        self.assertIn("jitter", out)
        self.assertRegex(out, r"vcan0: 10 frames in 0\.090 s, 111\.1 per second; load \d+\.\d+ % of 500 kbit/s")
        self.assertIn("never seen", out)


class Help(CanTest):
    def test_every_command_has_help(self):
        for command in (["can"], ["can", "dump"], ["can", "stats"], ["can", "decode"], ["can", "convert"],
                        ["can", "dbc"], ["can", "dbc", "check"], ["decode"]):
            out = self.run_ok(*command, "--help").out
            self.assertIn("Exit codes", out) if command != ["can", "dbc"] else self.assertIn("check", out)

    def test_bad_usage(self):
        for arguments in (["can"], ["can", "dbc"], ["can", "dump"], ["can", "dump", "vcan0"], ["can", "dump", "loop"],
                          ["can", "stats", "can:"], ["can", "dump", "udp:239.1.1.1"], ["decode"],
                          ["can", "dump", "can:vcan0", "--format", "xml"]):
            with self.subTest(arguments):
                answer = self.folder.run(*arguments)
                self.assert_code(2, answer)
                self.assertEqual(answer.out, "")


if __name__ == "__main__":
    unittest.main()
