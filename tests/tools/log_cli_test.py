#!/usr/bin/python3
"""`faultline log`: what it says of logs that are complete, cut, damaged, split, of other programs; cuts; tables.

The logs are taken apart and put together here by code that shares nothing with the program.
"""
import csv
import json
import os
import random
import re
import resource
import signal
import struct
import time
import unittest

from faultline_program import (Folder, FolderTest, decode, decode_all, finish, read_log, reassemble_parts,
                               wait_for)

SEED = int(os.environ.get("FAULTLINE_TEST_SEED", "20261123"))
KILLS = int(os.environ.get("FAULTLINE_TEST_KILLS", "5"))
CAN, SAMPLE, RUN, STATS = "FAULTLINE_CAN", "FAULTLINE_SAMPLE", "FAULTLINE_RUN", "FAULTLINE_STATS"
RESIDUAL, EVENT, DIAGNOSIS = "FAULTLINE_RESIDUAL", "FAULTLINE_EVENT", "FAULTLINE_DIAGNOSIS"
# In a message: fingerprint, utime, sequence. In STATS behind them: cycle, is_final, four counters.
SEQUENCE_AT, FRAMES_UNLOGGED_AT = 16, 32 + 1 + 4 * 8
SAMPLE_PERIOD_S = 0.01


def encode(events):
    return b"".join(b"\xED\xA1\xDA\x01" + struct.pack(">qqii", event.number, event.utime, len(event.channel),
                                                      len(event.data)) + event.channel.encode() + event.data
                    for event in events)


def sequence(event):
    return struct.unpack_from(">q", event.data, SEQUENCE_AT)[0]


def with_bytes(event, at, new):
    return event._replace(data=event.data[:at] + new + event.data[at + len(new):])


class LogTest(FolderTest):
    """With the log of a run, `own.lcm`, and its events."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.made = Folder(cls.cache)
        answer = cls.made.run("run", "demo.toml", "--log", "own.lcm", "--quiet")
        assert answer.code == 0, answer
        cls.log = cls.made.read("own.lcm")
        cls.events = read_log(cls.made.file("own.lcm"))[0]

    @classmethod
    def tearDownClass(cls):
        cls.made.remove()
        super().tearDownClass()

    def setUp(self):
        super().setUp()
        self.folder.write("own.lcm", self.log)

    def check(self, code, *files, **options):
        """Returns what `log check` says as data, and for people."""
        answer = self.folder.run("log", "check", *files, "--json", "-", **options)
        self.assert_code(code, answer)
        return json.loads(answer.out), answer.err

    def check_events(self, code, events):
        self.folder.write("changed.lcm", encode(events))
        return self.check(code, "changed.lcm")

    def fail(self, code, *arguments, **options):
        answer = self.folder.run("log", *arguments, **options)
        self.assert_code(code, answer)
        self.assertNotEqual(answer.err, "")
        self.assertEqual([name for name in os.listdir(self.folder.path) if name.endswith(".part")], [])
        return answer.err


class Check(LogTest):
    def channels(self, result):
        (run,) = result["runs"]
        return run["channels"]

    def test_a_whole_log_is_complete(self):
        result, text = self.check(0, "own.lcm")
        counts = {name: len(messages) for name, messages in decode_all(self.events).items()}
        channels = self.channels(result)
        self.assertEqual({name: channel["logged"] for name, channel in channels.items()}, counts)
        self.assertEqual({name: channel["published"] for name, channel in channels.items()}, counts)
        self.assertEqual(text.count("published = logged"), len(counts))
        self.assertIn("complete: all that the run published is logged", text)
        (run,) = result["runs"]
        self.assertEqual((run["first_cycle"], run["last_cycle"], run["ended"]), (0, 1000, True))
        self.assertEqual({part["part"]: part["whole"] for part in run["parts"]},
                         {part: True for part in ("scenario", "plant", "dbc", "bank_request", "bank")})
        with open(self.folder.file("own.lcm")) as log:
            self.assertEqual(self.check(0, "-", stdin=log)[0]["runs"], result["runs"])

    def test_missing_messages_are_named(self):
        missing = {10, 11, 12, 50}
        result, text = self.check_events(1, [event for event in self.events
                                             if event.channel != SAMPLE or sequence(event) not in missing])
        channels = self.channels(result)
        self.assertEqual(channels[SAMPLE]["missing_ranges"], [[10, 12], [50, 50]])
        self.assertEqual({name for name in channels if channels[name]["missing"]}, {SAMPLE})
        self.assertIn("MISSING 4: 10-12, 50\n", text)
        self.assertIn("NOT COMPLETE", text)
        self.assertEqual(result["missing_events"], 4)

    def test_of_many_gaps_people_see_the_first_and_data_has_all(self):
        result, text = self.check_events(1, [event for event in self.events
                                             if event.channel != SAMPLE or sequence(event) % 10 != 5])
        self.assertEqual(len(self.channels(result)[SAMPLE]["missing_ranges"]), 100)
        self.assertIn("MISSING 100: 5, 15, 25, 35, 45, 55, 65, 75, 85, 95, ..\n", text)

    def test_the_last_stats_prove_the_tail(self):
        last = {channel: max(sequence(event) for event in self.events if event.channel == channel)
                for channel in (SAMPLE, DIAGNOSIS, CAN)}
        result, _ = self.check_events(1, [event for event in self.events
                                          if sequence(event) != last.get(event.channel)])
        for channel, number in last.items():
            self.assertEqual(self.channels(result)[channel]["missing_ranges"], [[number, number]])
        result, _ = self.check_events(1, [event for event in self.events if event.channel != EVENT])
        self.assertEqual(self.channels(result)[EVENT],
                         {"logged": 0, "published": 1, "missing": 1, "missing_ranges": [[0, 0]], "beyond": 0,
                          "repeats": 0, "differing_repeats": 0})

    def test_frames_are_counted_too(self):
        lost = next(event for event in self.events if event.channel == CAN and sequence(event) == 3)
        batch = decode(lost)
        result, _ = self.check_events(1, [event for event in self.events if event is not lost])
        frames = result["runs"][0]["frames"]
        first, count = batch["first_frame"], batch["frame_count"]
        self.assertEqual(frames["missing_ranges"], [[first, first + count - 1]])
        self.assertEqual(frames["logged"], 5005 - count)

    def test_frames_that_the_run_could_not_log_are_told(self):
        events = [with_bytes(event, FRAMES_UNLOGGED_AT, struct.pack(">q", 7)) if event.channel == STATS else event
                  for event in self.events]
        result, text = self.check_events(1, events)
        self.assertEqual(result["runs"][0]["frames"]["unlogged"], 7)
        self.assertIn("7 NOT LOGGED, as the run says itself", text)

    def test_a_log_without_the_end_is_complete_to_its_end(self):
        result, text = self.check_events(1, self.events[:1200])
        (run,) = result["runs"]
        self.assertEqual((run["complete"], run["no_gaps"], run["ended"]), (False, True, False))
        self.assertRegex(text, r"the run did not end: the log stops at cycle \d+ \(killed, still running, or cut\); "
                               "complete up to there")
        # A gap there counts all the same, and the last STATS still prove what came before them.
        self.assertFalse(self.check_events(1, self.events[:500] + self.events[501:1200])[0]["runs"][0]["no_gaps"])
        before = max(i for i, event in enumerate(self.events[:1200]) if event.channel == STATS)
        events = [event for event in self.events[:before] if event.channel != DIAGNOSIS] + [self.events[before]]
        channel = self.channels(self.check_events(1, events)[0])[DIAGNOSIS]
        self.assertEqual((channel["logged"], channel["missing"] > 0), (0, True))

    def test_a_log_that_begins_late_says_where(self):
        runs = [event for event in self.events if event.channel == RUN]
        events = self.events[700:] + runs + self.events[-1:]
        result, text = self.check_events(1, self.events[700:1500] + runs + self.events[1500:])
        (run,) = result["runs"]
        first = min(decode(event)["cycle"] for event in events if event.channel == SAMPLE)
        self.assertEqual((run["begins_late"], run["no_gaps"], run["first_cycle"]), (True, True, first))
        self.assertIn(f"the log begins at cycle {first}; complete from there", text)
        _, text = self.check_events(1, self.events[700:])
        self.assertIn("what the run was made from (RUN) is MISSING", text)

    def test_repeated_run_messages_must_be_the_same(self):
        runs = [event for event in self.events if event.channel == RUN]
        result, text = self.check_events(0, self.events[:900] + runs + self.events[900:] + runs)
        self.assertEqual(self.channels(result)[RUN]["repeats"], 2 * len(runs))
        self.assertIn(f"published = logged; repeated {2 * len(runs)} times", text)
        changed = with_bytes(runs[1], len(runs[1].data) - 5, b"?")
        result, text = self.check_events(1, self.events[:900] + [changed] + self.events[900:])
        self.assertEqual(self.channels(result)[RUN]["differing_repeats"], 1)

    def test_a_part_that_is_not_what_its_digest_says_is_told(self):
        changed = [with_bytes(event, len(event.data) - 5, b"?") if event.channel == RUN and sequence(event) == 1
                   else event for event in self.events]
        result, text = self.check_events(1, changed)
        self.assertEqual([part["part"] for part in result["runs"][0]["parts"] if not part["whole"]], ["plant"])
        self.assertIn("part plant (plant.toml) is INCOMPLETE or differs", text)

    def test_a_message_twice_is_told(self):
        again = next(event for event in self.events if event.channel == SAMPLE)
        result, text = self.check_events(1, self.events + [again])
        self.assertEqual(self.channels(result)[SAMPLE]["repeats"], 1)
        self.assertIn("1 TWICE", text)

    def test_more_than_the_run_says_is_told(self):
        more = next(event for event in self.events if event.channel == SAMPLE)
        result, _ = self.check_events(1, self.events + [with_bytes(more, SEQUENCE_AT, struct.pack(">q", 5000))])
        channel = self.channels(result)[SAMPLE]
        self.assertEqual((channel["beyond"], channel["missing"]), (1, 0))

    def test_order_does_not_matter(self):
        generator = random.Random(SEED)
        events = sorted(enumerate(self.events), key=lambda item: item[0] + generator.uniform(0, 50))
        result, _ = self.check_events(0, [event for _, event in events])
        self.assertTrue(result["complete"])

    def test_several_runs_in_one_log_are_told_apart(self):
        self.run_ok("run", "fig05.toml", "--log", "second.lcm", "--quiet")
        result, _ = self.check_events(0, self.events + read_log(self.folder.file("second.lcm"))[0])
        self.assertEqual([run["complete"] for run in result["runs"]], [True, True])
        self.assertEqual(len({run["run_id"] for run in result["runs"]}), 2)

    def test_another_schema_version_is_told(self):
        events = [with_bytes(event, 0, b"\0\1\2\3\4\5\6\7") if event.channel == SAMPLE else event
                  for event in self.events]
        result, text = self.check_events(1, events)
        self.assertEqual(result["other_schema"], {"sample_t": 1001})
        self.assertIn("another schema version: 1001 messages of sample_t\n", text)

    def test_damaged_messages_are_told(self):
        index = next(i for i, event in enumerate(self.events) if event.channel == RESIDUAL)
        short = self.events[index]._replace(data=self.events[index].data[:-1])
        result, text = self.check_events(1, self.events[:index] + [short] + self.events[index + 1:])
        self.assertEqual(result["undecodable"], {"residual_t": 1})
        self.assertEqual(self.channels(result)[RESIDUAL]["missing_ranges"], [[0, 0]])

    def test_damage_of_the_file_is_told_with_place_and_length(self):
        at = len(encode(self.events[:1000]))
        self.folder.write("damaged.lcm", self.log[:at] + b"garbage" * 10 + self.log[at:])
        result, text = self.check(1, "damaged.lcm")
        self.assertEqual([(damage["offset"], damage["bytes"]) for damage in result["damages"]], [(at, 70)])
        self.assertTrue(result["runs"][0]["complete"])
        self.assertIn(f"damaged.lcm: byte {at}: no event where one should begin; 70 bytes passed over", text)
        # What damage swallows is missing, and nothing else.
        self.folder.write("damaged.lcm", self.log[:at] + b"\0" * 30 + self.log[at + 30:])
        result, _ = self.check(1, "damaged.lcm")
        lost = self.events[1000]
        self.assertEqual({name: channel["missing_ranges"] for name, channel in self.channels(result).items()
                          if channel["missing"]}, {lost.channel: [[sequence(lost)] * 2]})

    def test_of_other_programs_logs_only_the_events_can_be_checked(self):
        others = [event._replace(channel="POSE") for event in self.events]
        result, text = self.check_events(0, others)
        self.assertEqual((result["runs"], result["other_channels"]), ([], {"POSE": len(others)}))
        self.assertIn("no message of a run of ours is in it", text)
        result, _ = self.check_events(1, others[:100] + others[103:])
        self.assertEqual(result["missing_events"], 3)

    def test_bad_input(self):
        self.folder.write("empty.lcm", b"")
        self.folder.write("text.lcm", "schema = 1\n")
        for command in ("check", "info"):
            self.assertIn("it is empty", self.fail(2, command, "empty.lcm"))
            self.assertIn("found no LCM event at its start, expected an LCM log", self.fail(2, command, "text.lcm"))
            self.fail(2, command, "nosuch.lcm")
            self.fail(2, command, ".")
            self.fail(2, command)
        self.fail(2, "check", "own.lcm", "text.lcm")
        self.fail(3, "check", "own.lcm", "--json", "/dev/full")


class Info(LogTest):
    def test_is_what_info_says_of_a_log(self):
        one, other = (self.run_ok(*command, "own.lcm") for command in (["info"], ["log", "info"]))
        self.assertEqual(one.out, other.out)
        result = json.loads(self.run_ok("log", "info", "own.lcm", "--json", "-").out)
        self.assertEqual((result["first_cycle"], result["last_cycle"], result["ended"]), (0, 1000, True))
        self.assertEqual(result["first_utime"], self.events[0].utime)
        stats = decode([event for event in self.events if event.channel == STATS][-1])
        for name in ("cycle", "frames_sent", "frames_received", "samples", "bad_samples", "allocations"):
            self.assertEqual(result["stats"][name], stats[name], name)
        self.assertEqual(result["run_id"], decode(self.events[0])["run_id"])
        date = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(self.events[0].utime // 1000000))
        self.assertIn(f"from {date}", one.out)

    def test_tells_of_damage_and_of_an_end_that_is_not_there(self):
        self.folder.write("part.lcm", self.log[:100000])
        out = self.run_ok("log", "info", "part.lcm").out
        self.assertIn("the run did not end in it", out)
        self.assertRegex(out, r"part.lcm: byte \d+: an event that is cut off; \d+ bytes passed over, the end of the log")

    def test_shows_latencies(self):
        stats = [event for event in self.events if event.channel == STATS][-1]
        histogram = (struct.pack(">i", 5) + b"read\0" + struct.pack(">qqqqii", 4, 10, 9000, 0, 1, 2) +
                     struct.pack(">qqqq", 1000, 10000, 3, 1))
        at = 32 + 1 + 13 * 8
        self.assertEqual(struct.unpack_from(">i", stats.data, at), (0,))
        changed = stats._replace(data=stats.data[:at] + struct.pack(">i", 1) + histogram + stats.data[at + 4:])
        self.folder.write("changed.lcm", encode(self.events[:-1] + [changed]))
        self.assertRegex(self.run_ok("log", "info", "changed.lcm").out, r"read +4 +1\.0 +9\.0 +9\.0 +9\.0 +9\.0\n")


class Split(LogTest):
    def test_the_files_of_a_split_run_are_one_log(self):
        out = self.run_ok("run", "demo.toml", "--log", "split.lcm", "--log-split-size", "0.1", "--quiet").out
        self.assertIn("split-*.lcm", out)
        files = [f"split-{number:04}.lcm" for number in range(1, 8)]
        self.assertEqual([os.path.basename(log) for log in self.folder.logs()], ["own.lcm", *files])
        result, _ = self.check(0, *files)
        self.assertEqual(result["runs"][0]["channels"][RUN]["repeats"], 6 * 5)
        info = json.loads(self.run_ok("log", "info", *files, "--json", "-").out)
        self.assertEqual((info["first_cycle"], info["last_cycle"], info["ended"]), (0, 1000, True))
        messages = [event for file in files for event in read_log(self.folder.file(file))[0] if event.channel != RUN]
        whole = [event for event in self.events if event.channel != RUN]
        self.assertEqual([(event.channel, sequence(event)) for event in messages],
                         [(event.channel, sequence(event)) for event in whole])
        self.folder.write("split-0008.lcm", b"")  # as a kill leaves it
        self.check(0, *files, "split-0008.lcm")
        self.fail(2, "check", "split-0008.lcm", "split-0008.lcm")
        # A file that is missing is a gap; each alone has what the run was made from.
        self.assertFalse(self.check(1, *files[:3], *files[4:])[0]["runs"][0]["no_gaps"])
        for file in files:
            self.assertLessEqual(os.path.getsize(self.folder.file(file)), 100000)
            events, rest = read_log(self.folder.file(file))
            self.assertEqual(rest, 0)
            parts = reassemble_parts(decode(event) for event in events if event.channel == RUN)
            self.assertEqual(parts["plant"], self.folder.read("plant.toml"))
            self.assertTrue(self.check(1, file)[0]["runs"][0]["no_gaps"], file)

    def test_by_time_and_keeping_the_newest(self):
        self.run_ok("run", "demo.toml", "--log", "split.lcm", "--log-split-time", "2", "--log-keep", "2", "--quiet")
        logs = [os.path.basename(log) for log in self.folder.logs()]
        self.assertEqual(logs, ["own.lcm", "split-0005.lcm", "split-0006.lcm"])
        result, text = self.check(1, *logs[1:])
        self.assertEqual((result["runs"][0]["first_cycle"], result["runs"][0]["no_gaps"]), (800, True))

    def test_in_real_time(self):
        self.folder.patch("demo.toml", ("duration_s = 10.0", "duration_s = 1.0"))
        text = self.folder.read("demo.toml").decode()
        self.folder.write("demo.toml", text[:text.index("[[fault]]")])
        self.run_ok("run", "demo.toml", "--realtime", "--log", "rt.lcm", "--log-split-time", "0.2", "--quiet")
        files = [os.path.basename(log) for log in self.folder.logs() if "rt-" in log]
        self.assertGreaterEqual(len(files), 4)
        self.check(0, *files)

    def test_bad_options(self):
        for options in (["--log-keep", "2"], ["--log-split-size", "0"], ["--log-split-time", "-1"],
                        ["--log-split-size", "1", "--no-log"], ["--log-split-size", "1", "--log-keep", "0"]):
            with self.subTest(options=options):
                self.assert_code(2, self.folder.run("run", "demo.toml", *options))
        self.assertEqual([os.path.basename(log) for log in self.folder.logs()], ["own.lcm"])
        self.folder.write("split-0003.lcm", "a diary")
        answer = self.folder.run("run", "demo.toml", "--log", "split.lcm", "--log-split-size", "1")
        self.assert_code(2, answer)
        self.assertEqual(self.folder.read("split-0003.lcm"), b"a diary")

    def test_a_log_that_may_grow_no_more_ends_the_run_and_stays_readable(self):
        def limit():
            resource.setrlimit(resource.RLIMIT_FSIZE, (150000, 150000))
        for options in ([], ["--realtime"]):
            with self.subTest(options=options):
                answer = self.folder.run("run", "demo.toml", "--log", "full.lcm", "--quiet", *options,
                                         preexec_fn=limit)
                self.assert_code(3, answer)
                self.assertRegex(answer.err, "log full.lcm: cannot write: File too large")
                result, _ = self.check(1, "full.lcm")
                self.assertTrue(result["runs"][0]["no_gaps"])
                self.assertLessEqual({damage["at_end"] for damage in result["damages"]}, {True})


def read_mat(data):
    """{variable: [value]} of a MAT-file level 5 with columns of doubles, int64 and texts, as MATLAB's format says."""
    def element(data, at):
        kind, size = struct.unpack_from("<II", data, at)
        return kind, data[at + 8:at + 8 + size], at + 8 + (size + 7) // 8 * 8

    def array(data):
        parts, at = [], 0
        while at < len(data):
            kind, part, at = element(data, at)
            parts.append((kind, part))
        (flags_kind, flags), (sizes_kind, sizes), (name_kind, name), *values = parts
        assert (flags_kind, sizes_kind, name_kind) == (6, 5, 1), parts[:3]
        rows, columns = struct.unpack("<ii", sizes)
        array_class = struct.unpack_from("<I", flags)[0]
        if array_class == 1:  # cells
            assert columns == 1 and len(values) == rows and all(kind == 14 for kind, _ in values)
            return name.decode(), [array(part)[1] for _, part in values]
        ((kind, part),) = values
        if array_class == 4:
            text = part.decode()
            assert kind == 16 and len(text) == columns and rows == (1 if text else 0)
            return name.decode(), text
        assert columns == 1 and (array_class, kind) in ((6, 9), (14, 12)), (array_class, kind)
        return name.decode(), list(struct.unpack(f"<{rows}{'d' if kind == 9 else 'q'}", part))

    assert data[:19] == b"MATLAB 5.0 MAT-file" and data[124:128] == b"\0\1IM"
    variables, at = {}, 128
    while at < len(data):
        kind, part, end = element(data, at)
        assert kind == 14 and end <= len(data)
        name, values = array(part)
        assert name not in variables
        variables[name] = values
        at = end
    return variables


class Cut(LogTest):
    def cut(self, *options, log="own.lcm"):
        self.run_ok("log", "cut", log, "-o", "cut.lcm", *options)
        events, rest = read_log(self.folder.file("cut.lcm"))
        self.assertEqual(rest, 0)
        return events

    def time(self, event):
        return event.utime - self.events[0].utime

    def test_by_time_keeps_events_to_the_byte(self):
        events = self.cut("--from", "3", "--to", "5")
        expected = [event for event in self.events if event.channel == RUN or 3e6 <= self.time(event) < 5e6]
        across = [event for event in events if event not in expected]
        self.assertEqual([event for event in events if event not in across], expected)
        # A batch across the end, of which frames belong to what is kept.
        for event in across:
            frames = decode(event)["frames"]
            self.assertLess(frames[0]["stamp_ns"] // 1000 - self.events[0].utime, 5e6)
        self.assertEqual({event.channel for event in across}, {CAN})
        result, text = self.check(1, "cut.lcm")
        self.assertTrue(result["runs"][0]["no_gaps"])
        self.assertTrue(all(part["whole"] for part in result["runs"][0]["parts"]))

    def test_cuts_that_meet_share_only_run_and_a_batch(self):
        first, second = self.cut("--to", "5"), self.cut("--from", "5")
        both = [event for event in first if event in second]
        self.assertEqual({event.channel for event in both}, {RUN, CAN})
        self.assertEqual(len([event for event in both if event.channel == CAN]), 1)
        self.assertEqual({event.number for event in first + second}, {event.number for event in self.events})
        self.assertEqual(self.cut(), self.events)

    def test_by_cycles_has_their_samples_and_frames(self):
        messages = decode_all(self.cut("--from-cycle", "400", "--to-cycle", "450"))
        for channel in (SAMPLE, RESIDUAL):
            self.assertEqual([message["cycle"] for message in messages[channel]], list(range(400, 450)))
        stamps = {frame["stamp_ns"] for batch in messages[CAN] for frame in batch["frames"]}
        begin = self.events[0].utime
        for cycle in range(400, 450):
            self.assertIn((begin + cycle * 10000) * 1000, stamps)
        self.assertLess(sum(batch["frame_count"] for batch in messages[CAN]), 50 * 5 + 3 * 64)

    def test_by_channels_keeps_run_too(self):
        self.assertEqual(self.cut("--channel", "SAMPLE", "FAULTLINE_DIAGNOSIS"),
                         [event for event in self.events if event.channel in (RUN, SAMPLE, DIAGNOSIS)])

    def test_run_messages_that_come_late_are_kept(self):
        runs = [event for event in self.events if event.channel == RUN]
        rest = [event for event in self.events if event.channel != RUN]
        self.folder.write("late.lcm", encode(rest + runs))
        events = self.cut("--from", "1", "--to", "2", log="late.lcm")
        self.assertEqual(events[-len(runs):], runs)
        self.folder.write("live.lcm", encode(runs + rest[:900] + runs + rest[900:] + runs))
        events = self.cut("--from", "8", log="live.lcm")
        self.assertEqual([event for event in events if event.channel == RUN], runs)
        self.assertEqual(events[:len(runs)], runs)

    def test_of_two_runs_the_one_that_is_kept_has_its_parts(self):
        self.run_ok("run", "fig05.toml", "--log", "second.lcm", "--quiet")
        second = read_log(self.folder.file("second.lcm"))[0]
        self.folder.write("two.lcm", self.log + encode(second))
        begin = (second[0].utime - self.events[0].utime) / 1e6
        self.assertGreater(begin, 0)
        events = self.cut("--from", repr(max(begin + 1, 10.5)), log="two.lcm")
        ids = {decode(event)["run_id"] for event in events if event.channel == RUN}
        self.assertEqual(ids, {decode(second[0])["run_id"]})

    def test_passes_over_damage(self):
        at = len(encode(self.events[:1000]))
        self.folder.write("damaged.lcm", self.log[:at] + b"garbage" + self.log[at:])
        self.assertEqual(self.cut(log="damaged.lcm"), self.events)

    def test_bad_input(self):
        self.folder.write("diary", "dear diary")
        os.link(self.folder.file("own.lcm"), self.folder.file("link.lcm"))
        for expected, arguments in {
                "same file": ["own.lcm", "-o", "own.lcm"],
                "expected another": ["own.lcm", "-o", "link.lcm"],
                "no LCM log": ["own.lcm", "-o", "diary"],
                "no ordinary file": ["own.lcm", "-o", "."],
                "found no event between": ["own.lcm", "-o", "cut.lcm", "--from", "100"],
                "expected --to behind --from": ["own.lcm", "-o", "cut.lcm", "--from", "5", "--to", "5"],
                "found samples of cycles 0 to 1000": ["own.lcm", "-o", "cut.lcm", "--from-cycle", "1001"],
                "found no channel POSE, expected one of": ["own.lcm", "-o", "cut.lcm", "--channel", "POSE"],
                "finite": ["own.lcm", "-o", "cut.lcm", "--from", "nan"],
                "excludes": ["own.lcm", "-o", "cut.lcm", "--from", "1", "--to-cycle", "2"],
                "expected an LCM log": ["diary", "-o", "cut.lcm"],
                "nosuch.lcm": ["nosuch.lcm", "-o", "cut.lcm"],
                "--output": ["own.lcm"]}.items():
            with self.subTest(arguments=arguments):
                self.assertIn(expected, self.fail(2, "cut", *arguments))
        self.assertIn("cannot write", self.fail(3, "cut", "own.lcm", "-o", "nosuch/cut.lcm"))
        self.assertEqual(self.folder.read("own.lcm"), self.log)
        self.assertEqual(self.folder.read("diary"), b"dear diary")
        self.assertFalse(os.path.exists(self.folder.file("cut.lcm")))


class Export(LogTest):
    def export(self, *options, log="own.lcm"):
        """Returns {table: [row as {column: cell}]}."""
        self.run_ok("log", "export", log, "-o", "tables", *options)
        tables = {}
        for name in os.listdir(self.folder.file("tables")):
            with open(self.folder.file(f"tables/{name}"), newline="") as file:
                tables[name.removesuffix(".csv")] = list(csv.DictReader(file, strict=True))
        return tables

    def test_numbers_read_back_to_the_bit(self):
        tables, messages = self.export(), decode_all(self.events)
        self.assertEqual(set(tables), {"can", "sample", "residual", "diagnosis", "estimate", "truth", "event", "stats"})
        begin = self.events[0].utime
        filters = ["r12", "r13", "r14", "r23", "r24", "r34"]
        for table, channel, values in (
                ("sample", SAMPLE, lambda m: dict(zip(["y1", "y2", "y3", "u1", "u2", "u3", "u4"], m["y"] + m["u"]))),
                ("residual", RESIDUAL, lambda m: {
                    **dict(zip(filters, m["residual"])),
                    **dict(zip([f"{name}_evaluation" for name in filters], m["evaluation"])),
                    **dict(zip([f"{name}_threshold" for name in filters], m["threshold"])),
                    **dict(zip([f"{name}_fired" for name in filters], m["fired"]))}),
                ("truth", "FAULTLINE_TRUTH", lambda m: dict(zip(["x1", "x2", "x3"], m["x"])))):
            self.assertEqual(len(tables[table]), len(messages[channel]), table)
            for row, message in zip(tables[table], messages[channel]):
                for name, value in {**values(message), "cycle": message["cycle"], "utime": message["utime"],
                                    "t_s": (message["utime"] - begin) / 1e6}.items():
                    self.assertEqual(float(row[name]), value, name)

    def test_verdicts_estimates_truth_and_counters_have_their_words(self):
        tables, messages = self.export(), decode_all(self.events)
        for row, message in zip(tables["diagnosis"], messages[DIAGNOSIS]):
            for name in ("verdict", "cause", "blame"):
                self.assertEqual(row[name], message[name])
            self.assertEqual(row["sets"], " | ".join(", ".join(found["faults"]) for found in message["sets"]))
        self.assertIn("u2, u3", {row["sets"] for row in tables["diagnosis"]})
        for row, message in zip(tables["estimate"], messages["FAULTLINE_ESTIMATE"]):
            known = {fault: repr(value) for fault, value in zip(message["fault"], message["estimate"])}
            self.assertEqual({fault: repr(float(row[fault])) for fault in ("u1", "u2", "u3", "u4") if row[fault]}, known)
        self.assertIn("u2 bias 2, u3 bias 2", {row["faults"] for row in tables["truth"]})
        self.assertEqual([int(row["frames_sent"]) for row in tables["stats"]],
                         [message["frames_sent"] for message in messages[STATS]])
        self.assertEqual(tables["event"][0]["text"], messages[EVENT][0]["text"])

    def test_frames_have_a_row_each(self):
        rows, batches = self.export("--channel", "CAN")["can"], decode_all(self.events)[CAN]
        self.assertEqual(os.listdir(self.folder.file("tables")), ["can.csv"])
        frames = [frame for batch in batches for frame in batch["frames"]]
        self.assertEqual(len(rows), len(frames))
        for number, (row, frame) in enumerate(zip(rows, frames)):
            self.assertEqual((int(row["number"]), int(row["stamp_ns"]), int(row["id"]), bytes.fromhex(row["data"])),
                             (number, frame["stamp_ns"], frame["id"], bytes(frame["data"])))

    def test_text_is_quoted(self):
        odd = 'a "quoted", odd\r\ntext'
        event = next(event for event in self.events if event.channel == EVENT)
        data = event.data[:32] + b"".join(struct.pack(">i", len(text) + 1) + text.encode() + b"\0"
                                          for text in ("info", "bench", odd))
        self.folder.write("odd.lcm", encode([event._replace(data=data)]))
        self.assertEqual(self.export(log="odd.lcm")["event"][0]["text"], odd)

    def test_without_a_bank_columns_are_counted(self):
        self.folder.write("bare.lcm", encode(event for event in self.events if event.channel != RUN))
        tables = self.export(log="bare.lcm")
        self.assertLessEqual({"y1", "y3", "u4"}, set(tables["sample"][0]))
        self.assertLessEqual({"r1", "r6", "filter6_fired"}, set(tables["residual"][0]))
        self.assertLessEqual({"u2", "u3_deviation"}, set(tables["estimate"][0]))

    def test_mat_files_hold_the_same(self):
        tables = self.export()
        self.run_ok("log", "export", "own.lcm", "-o", "mat", "--format", "mat")
        self.assertEqual({name.removesuffix(".mat") for name in os.listdir(self.folder.file("mat"))}, set(tables))
        for name, rows in tables.items():
            variables = read_mat(self.folder.read(f"mat/{name}.mat"))
            self.assertEqual(set(variables), set(rows[0]), name)
            for column, values in variables.items():
                cells = [row[column] for row in rows]
                if isinstance(values[0], float):  # NaN: none
                    self.assertEqual([float(cell or "nan") for cell in cells if cell], [v for v in values if v == v])
                    self.assertEqual([not cell for cell in cells], [value != value for value in values], column)
                else:
                    self.assertEqual(cells, [str(value) for value in values], column)

    def test_what_is_in_no_table_is_told(self):
        short = next(event for event in self.events if event.channel == SAMPLE)
        others = [short._replace(data=short.data[:-1]), short._replace(channel="POSE")]
        self.folder.write("mixed.lcm", self.log + encode(others) + b"garbage")
        answer = self.run_ok("log", "export", "mixed.lcm", "-o", "tables")
        self.assertIn("FAULTLINE_SAMPLE: 1 messages are in no table", answer.err)
        self.assertIn("POSE: 1 messages are in no table", answer.err)
        self.assertIn("1 damaged places", answer.err)

    def test_bad_input(self):
        self.folder.write("file", "")
        self.folder.write("other.lcm", encode(event._replace(channel="POSE") for event in self.events[:3]))
        self.assertIn("found a file, expected a folder", self.fail(2, "export", "own.lcm", "-o", "file"))
        self.assertIn("found no messages of a run", self.fail(2, "export", "other.lcm", "-o", "tables"))
        self.fail(2, "export", "own.lcm", "-o", "tables", "--format", "xls")
        self.assertIn("found no channel X", self.fail(2, "export", "own.lcm", "-o", "tables", "--channel", "X"))
        self.assertIn("cannot make folder", self.fail(3, "export", "own.lcm", "-o", "file/tables"))
        self.assertFalse(os.path.exists(self.folder.file("tables")))


class Damage(LogTest):
    def damaged(self, generator):
        """A log with a few changes of every kind, in headers, messages and between them."""
        data = bytearray(self.log[:200000])
        for _ in range(generator.randint(1, 30)):
            at = generator.randrange(len(data))
            if generator.random() < 0.5:  # where it hurts: in an event's header or its message's counts
                at = min(data.find(b"\xED\xA1\xDA\x01", at) + generator.randrange(140), len(data) - 1)
            kind = generator.randrange(4)
            if kind == 0:
                data[at] ^= 1 << generator.randrange(8)
            elif kind == 1:
                data[at:at + 8] = generator.choice([b"\x7F" + b"\xFF" * 7, b"\x80" + bytes(7), b"\xFF" * 8, bytes(8)])
            elif kind == 2:
                del data[at:at + generator.randrange(1, 5000)]
            else:
                data[at:at] = generator.randbytes(generator.randrange(1, 500))
        return bytes(data)

    def test_no_log_is_too_damaged(self):
        generator = random.Random(SEED)
        for number in range(25):
            self.folder.write("damaged.lcm", self.damaged(generator))
            for arguments, codes in ((["check", "damaged.lcm", "--json", "-"], [1]), (["info", "damaged.lcm"], [0]),
                                     (["cut", "damaged.lcm", "-o", "cut.lcm", "--from-cycle", "50"], [0, 2]),
                                     (["export", "damaged.lcm", "-o", "tables"], [0])):
                with self.subTest(seed=SEED, number=number, arguments=arguments):
                    answer = self.folder.run("log", *arguments)
                    self.assertIn(answer.code, codes, answer.err)


class Kill(LogTest):
    """A bench that is killed in real time leaves a log that is complete to its end, and verifies."""

    def kill_one(self, delay_s, options):
        for log in self.folder.logs():
            os.remove(log)
        process = self.folder.start("run", "long.toml", "--realtime", "--log", "killed.lcm", "--quiet", *options)
        self.addCleanup(lambda: process.poll() is None and process.kill())
        wait_for(lambda: any(os.path.getsize(log) > 20000 for log in self.folder.logs()))
        time.sleep(delay_s)
        killed_s = time.time()
        process.kill()
        self.assertEqual(finish(process).code, -signal.SIGKILL)
        files = [os.path.basename(log) for log in self.folder.logs()]
        result, text = self.check(1, *files)
        (run,) = result["runs"]
        self.assertTrue(run["no_gaps"], text)
        self.assertFalse(run["ended"])
        self.assertLessEqual(len(result["damages"]), 1)
        for damage in result["damages"]:
            self.assertTrue(damage["at_end"], text)
            self.assertEqual(damage["file"], files[-1])
        verified = self.run_ok("replay", *files, "--verify")
        self.assertIn("VERIFIED: reproduced to the bit", verified.out)
        self.assertIn("the log ends before the run did", verified.out)
        events = [event for file in files for event in read_log(self.folder.file(file))[0]]
        return killed_s - max(event.utime for event in events if event.channel == SAMPLE) / 1e6

    def test_at_random_moments(self):
        text = self.folder.read("demo.toml").decode()
        self.folder.write("long.toml", re.sub(r"duration_s = .*", "duration_s = 1000.0",
                                              text[:text.index("[[expect]]")]))
        generator = random.Random(SEED)
        print(f"FAULTLINE_TEST_SEED={SEED}")
        for number in range(KILLS):
            options = ["--log-split-time", "0.2"] if number % 2 else []
            with self.subTest(number=number, options=options):
                lost_s = self.kill_one(generator.uniform(0.0, 0.6), options)
                # Told, not asserted: how long it takes is the machine's.
                print(f"kill {number}: the log ends {1e3 * lost_s:.0f} ms before it")


if __name__ == "__main__":
    unittest.main()
