#!/usr/bin/python3
"""The program `faultline` as a user meets it: commands, results, exit codes, bad input, signals, kill."""
import concurrent.futures
import json
import os
import random
import re
import shutil
import signal
import subprocess
import time
import unittest

from faultline_program import (EXAMPLE, Folder, FolderTest, decode, decode_all, finish, program, read_log,
                               reassemble_parts, wait_for)

FAULTS = ["u1", "u2", "u3", "u4"]
PAIRS = ["r12", "r13", "r14", "r23", "r24", "r34"]
# Without x1 among the outputs, pairs of faults have no solution.
UNSOLVABLE = [("     [1, 0, 2]]", "     [0, 0, 2]]")]
STOP_WITHIN_S = 2.0
LONG_S = "1e5"  # at 100 Hz: minutes in lock-step


def without_comments(text):
    return "\n".join(line for line in text.splitlines() if not line.lstrip().startswith("#")) + "\n"


class Help(FolderTest):
    def test_help_of_the_program_names_commands_and_exit_codes(self):
        out = self.run_ok("--help").out
        for word in ("run", "design", "check", "info", "--version", "Exit codes"):
            self.assertIn(word, out)

    def test_help_of_every_command_names_its_options(self):
        options = {"run": ["SCENARIO", "--bus", "--realtime", "--overrun", "--priority", "--cpu", "--probe", "--log", "--no-log",
                           "--lcm", "--json", "--quiet"],
                   "doctor": ["--json"],
                   "design": ["BANK", "--output", "--json"],
                   "check": ["BANK", "--plant", "--json"],
                   "info": ["FILE", "--json"]}
        for command, names in options.items():
            out = self.run_ok(command, "--help").out
            for name in [*names, "--help", "Exit codes"]:
                self.assertIn(name, out, command)

    def test_version(self):
        self.assertRegex(self.run_ok("--version").out, r"^faultline \d+\.\d+\.\d+\n$")

    def test_bad_usage(self):
        for arguments in ([], ["nonsense"], ["--nonsense"], ["run"], ["design"], ["check"], ["info"], ["run", "--nonsense", "x"],
                          ["run", "demo.toml", "more.toml"], ["run", "demo.toml", "--log"],
                          ["run", "demo.toml", "--log", "a.lcm", "--no-log"],
                          ["run", "demo.toml", "--bus", "vcan0"], ["run", "demo.toml", "--bus", "can:"],
                          ["run", "demo.toml", "--realtime", "--overrun", "never"],
                          ["run", "demo.toml", "--realtime", "--priority", "100"],
                          ["run", "demo.toml", "--realtime", "--cpu", "-1"],
                          ["run", "demo.toml", "--overrun", "skip"], ["run", "demo.toml", "--probe"]):
            with self.subTest(arguments=arguments):
                answer = self.folder.run(*arguments)
                self.assert_code(2, answer)
                self.assertEqual(answer.out, "")
                self.assertNotEqual(answer.err, "")
        self.assertEqual(self.folder.logs(), [])


class Check(FolderTest):
    def setUp(self):
        super().setUp()
        self.run_ok("design", "bank.toml")

    def tamper(self, change):
        bank = json.loads(self.folder.read("bank.bank.json"))
        change(bank)
        self.folder.write("bank.bank.json", json.dumps(bank))
        return self.folder.run("check", "bank.bank.json", "--plant", "plant.toml", "--json", "check.json")

    def test_a_fresh_bank_holds(self):
        answer = self.run_ok("check", "bank.bank.json", "--plant", "plant.toml")
        self.assertIn("OK: every claim holds", answer.out)
        (line,) = [line for line in answer.out.splitlines() if line.startswith("  r12 ")]
        for words in ("ignores u1, u2: leakage ", "sees u3, u4 with gain 1 .. 1", "margin 0.5",
                      "dims stable for tolerances 1e-12 .. 1e-06"):
            self.assertIn(words, line)
        self.assertIn("(u1, u2) = (2, 1)·g looks like (u3, u4) = (1, 1)·g", answer.out)

    def test_result_as_data(self):
        answer = self.run_ok("check", "bank.bank.json", "--plant", "plant.toml", "--json", "-")
        check = json.loads(answer.out)
        self.assertEqual((check["bank"], check["plant"], check["holds"], check["findings"]),
                         ("pairs", "hou2015", True, []))
        self.assertEqual([residual["name"] for residual in check["residuals"]], PAIRS)
        for residual in check["residuals"]:
            self.assertLess(residual["leakage"], 1e-3)
            self.assertEqual(residual["tolerances"], [1e-12, 1e-6])
        self.assertIn("OK", answer.err)

    def test_a_tampered_bank_is_a_negative_answer_that_says_where(self):
        def change(bank):
            bank["filters"][2]["E"][0][1] += 0.01

        answer = self.tamper(change)
        self.assert_code(1, answer)
        self.assertIn("WRONG", answer.out)
        self.assertIn("  r14: ", answer.out)
        check = json.loads(self.folder.read("check.json"))
        self.assertIs(check["holds"], False)
        self.assertEqual({finding["subject"] for finding in check["findings"]}, {"r14"})

    def test_a_tampered_certificate_is_a_negative_answer_with_both_numbers(self):
        def change(bank):
            bank["filters"][0]["certificate"]["margin"][2] = 0.75

        answer = self.tamper(change)
        self.assert_code(1, answer)
        self.assertIn("r12: margin of u3: the bank says 0.75, but it is 0.5", answer.out)
        (finding,) = json.loads(self.folder.read("check.json"))["findings"]
        self.assertEqual(finding, {"subject": "r12", "claim": "margin of u3", "stored": "0.75", "recomputed": "0.5"})

    def test_a_bank_for_another_plant_is_a_negative_answer(self):
        self.folder.patch("plant.toml", ("[2, 0, -4]]", "[2, 0, -4.5]]"))
        answer = self.folder.run("check", "bank.bank.json", "--plant", "plant.toml")
        self.assert_code(1, answer)
        self.assertIn("bank: digest of the plant", answer.out)

    def test_a_plant_with_other_channels_is_a_negative_answer(self):
        self.folder.patch("plant.toml", ('actuators = "all"', 'actuators = ["u1", "u2"]'))
        answer = self.folder.run("check", "bank.bank.json", "--plant", "plant.toml")
        self.assert_code(1, answer)
        self.assertIn("bank: faults", answer.out)

    def test_bad_input(self):
        for arguments, words in ((["bank.bank.json"], ["--plant"]),
                                 (["nosuch.bank.json", "--plant", "plant.toml"], ["nosuch.bank.json"]),
                                 (["bank.bank.json", "--plant", "nosuch.toml"], ["nosuch.toml"]),
                                 (["plant.toml", "--plant", "plant.toml"], ["plant.toml:1:"]),
                                 (["bank.bank.json", "--plant", "bank.toml"], ["bank.toml:"])):
            with self.subTest(arguments=arguments):
                answer = self.folder.run("check", *arguments)
                self.assert_code(2, answer)
                self.assertEqual(answer.out, "")
                for word in words:
                    self.assertIn(word, answer.err)

    def test_unwritable_data_is_a_failure(self):
        self.assert_code(3, self.folder.run("check", "bank.bank.json", "--plant", "plant.toml", "--json",
                                            "nosuch/check.json"))


class Run(FolderTest):
    def test_expectations_met(self):
        answer = self.run_ok("run", "demo.toml", "--json", "run.json")
        run = json.loads(self.folder.read("run.json"))
        self.assertEqual(run["scenario"], "demo")
        self.assertEqual(run["bus"], "loop")
        self.assertEqual(run["samples"], 1001)
        self.assertEqual([(verdict["verdict"], verdict["faults"]) for verdict in run["verdicts"]],
                         [("inhibited", []), ("healthy", []), ("isolated", ["u2", "u3"])])
        isolated = run["verdicts"][-1]
        self.assertEqual(isolated["cause"], "complete")
        self.assertAlmostEqual(isolated["onset_s"], 4.0, delta=0.0101)
        self.assertEqual([estimate["fault"] for estimate in isolated["estimates"]], ["u2", "u3"])
        for estimate in isolated["estimates"]:
            self.assertAlmostEqual(estimate["value"], 2.0, delta=2e-3)
            self.assertGreater(estimate["deviation"], 0.0)
        times = [verdict["t_s"] for verdict in run["verdicts"]]
        self.assertEqual(times, sorted(times))
        self.assertTrue(4.0 < times[-1] < 4.3)
        self.assertEqual(list(run["residuals"]), PAIRS)
        for name, residual in run["residuals"].items():
            if name == "r23":
                self.assertIsNone(residual["first_fired_s"])
            else:
                self.assertTrue(4.0 < residual["first_fired_s"] < 4.3)
        self.assertEqual({key: run["frames"][key] for key in ("sent", "received", "dropped")},
                         {"sent": 5005, "received": 5005, "dropped": 0})
        self.assertEqual(run["cycles"]["late"], 0)
        self.assertIs(run["expect"]["met"], True)
        for word in ("demo", "u2, u3", "isolated", "sent 5005", "dropped 0", "late 0", "faultline-logs", "met"):
            self.assertIn(word, answer.out)

    def test_data_on_stdout_stands_alone(self):
        answer = self.run_ok("run", "demo.toml", "--json", "-")
        self.assertEqual(json.loads(answer.out)["scenario"], "demo")
        self.assertIn("u2, u3", answer.err)

    def test_a_partial_signature_says_whose_it_could_be(self):
        answer = self.run_ok("run", "marginal_1.toml", "--no-log", "--json", "run.json")
        self.assertIn("partial signature, could be u1 | u4 below a threshold", answer.out)
        verdict = json.loads(self.folder.read("run.json"))["verdicts"][-1]
        self.assertEqual((verdict["verdict"], verdict["cause"], verdict["candidates"]),
                         ("unexplained", "partial", [["u1"], ["u4"]]))

    def test_the_summary_tells_size_and_onset_of_what_it_isolated(self):
        self.assertRegex(self.run_ok("run", "demo.toml", "--no-log").out,
                         r"u2 = \d\.\d+ \+- 0\.\d+, u3 = \d\.\d+ \+- 0\.\d+; onset (3\.99|4|4\.01) s")

    def test_progress_shows_the_current_verdict_and_quiet_none(self):
        self.folder.patch("demo.toml", ("duration_s = 10.0", "duration_s = 1000.0"),
                          ("until_s = 10.0", "until_s = 1000.0"))
        told = self.run_ok("run", "demo.toml", "--no-log").err  # takes 0.3 s; told every 0.1 s
        self.assertIn("inhibited", told)
        self.assertIn("isolated u2, u3", told)
        self.assertEqual(self.run_ok("run", "demo.toml", "--no-log", "--quiet").err, "")

    def test_an_unmet_expectation_is_a_negative_answer(self):
        self.folder.patch("demo.toml", ('faults  = ["u2", "u3"]', 'faults  = ["u1", "u3"]'))
        answer = self.folder.run("run", "demo.toml", "--json", "run.json")
        self.assert_code(1, answer)
        self.assertIn("NOT MET", answer.out)
        run = json.loads(self.folder.read("run.json"))
        self.assertIs(run["expect"]["met"], False)
        self.assertEqual([item["met"] for item in run["expect"]["items"]], [True, False])

    def test_an_expectation_after_the_end_of_the_run_is_not_met(self):
        self.folder.patch("demo.toml", ("from_s  = 4.3\nuntil_s = 10.0", "from_s  = 9.9999\nuntil_s = 9.9999"))
        self.assert_code(1, self.folder.run("run", "demo.toml"))

    def test_a_diverging_plant_is_a_negative_answer(self):
        self.folder.patch("demo.toml", ("duration_s = 10.0", "duration_s = 1000.0"),
                          ('kind = "lqr"', 'kind = "none"'))
        answer = self.folder.run("run", "demo.toml")
        self.assert_code(1, answer)
        self.assertIn("diverged", answer.out)
        (log,) = self.folder.logs()
        events, rest = read_log(log)
        self.assertEqual((events[-1].channel, rest), ("FAULTLINE_STATS", 0))

    def test_a_bank_without_solution_is_a_negative_answer(self):
        self.folder.patch("plant.toml", *UNSOLVABLE)
        answer = self.folder.run("run", "demo.toml")
        self.assert_code(1, answer)
        self.assertIn("ignoring {u1, u2} hides u3, u4: rank C W* = rank C = 2", answer.err)
        self.assertEqual(self.folder.logs(), [])

    def test_a_designed_bank_gives_the_run_of_its_request(self):
        self.run_ok("design", "bank.toml", "-o", "pairs.bank.json")
        self.run_ok("run", "demo.toml", "--log", "a.lcm")
        self.folder.patch("demo.toml", ('"bank.toml"', '"pairs.bank.json"'))
        self.run_ok("run", "demo.toml", "--log", "b.lcm")
        residuals = []
        for name in ("a.lcm", "b.lcm"):
            events, rest = read_log(self.folder.file(name))
            self.assertEqual(rest, 0)
            residuals.append([message["residual"] for message in decode_all(events)["FAULTLINE_RESIDUAL"]])
        self.assertEqual(len(residuals[0]), 1001)
        self.assertEqual(*residuals)

    def test_a_cached_bank_gives_the_same_run_and_a_damaged_cache_costs_only_time(self):
        self.folder.environment["XDG_CACHE_HOME"] = cache = self.folder.file("own-cache")
        first = json.loads(self.run_ok("run", "demo.toml", "--json", "-").out)
        (cached,) = os.listdir(f"{cache}/faultline")
        second = json.loads(self.run_ok("run", "demo.toml", "--json", "-").out)
        self.folder.write(f"{cache}/faultline/{cached}", "{")
        third = json.loads(self.run_ok("run", "demo.toml", "--json", "-").out)
        self.assertEqual(first["verdicts"], second["verdicts"])
        self.assertEqual(first["verdicts"], third["verdicts"])

    def test_runs_where_no_cache_can_be_written(self):
        self.folder.environment["XDG_CACHE_HOME"] = "/proc/nosuch"
        self.run_ok("run", "demo.toml")

    def test_real_time_takes_its_time(self):
        text = self.folder.read("demo.toml").decode()
        text = text[:text.index("[[expect]]")] + text[text.rindex("[[expect]]"):]
        for old, new in (("duration_s = 10.0", "duration_s = 2.0\ninitial_state_known = true"),
                         ("at_s   = 4.0", "at_s = 0.5"),
                         ("from_s  = 4.3\nuntil_s = 10.0", "from_s = 0.8\nuntil_s = 2.0")):
            text = text.replace(old, new)
        self.folder.write("demo.toml", text)
        begin = time.monotonic()
        run = json.loads(self.run_ok("run", "demo.toml", "--realtime", "--json", "-", "--log", "own.lcm").out)
        self.assertGreater(time.monotonic() - begin, 1.9)
        self.assertEqual(run["samples"], 201)
        self.assertIs(run["expect"]["met"], True)
        self.assertEqual(run["diagnosis_thread"]["allocations"], 0)
        self.assertIsInstance(run["diagnosis_thread"]["page_faults"], int)
        latency = {stage["stage"]: stage for stage in run["latency"]}
        self.assertEqual(latency["due->sent"]["values"], 201)
        for stage in latency.values():
            self.assertLessEqual(stage["p50_us"], stage["p99_us"])
            self.assertLessEqual(stage["p99_us"], stage["max_us"])
        events, rest = read_log(self.folder.file("own.lcm"))
        self.assertEqual((events[-1].channel, rest), ("FAULTLINE_STATS", 0))
        messages = decode_all(events)
        stats = messages["FAULTLINE_STATS"][-1]
        self.assertEqual(stats["allocations"], 0)
        self.assertEqual({stage["stage"]: stage["count"] for stage in stats["latency"]},
                         {name: stage["values"] for name, stage in latency.items()})
        for stage in stats["latency"]:
            self.assertEqual(sum(stage["counts"]), stage["count"])
        samples = messages["FAULTLINE_SAMPLE"]
        self.assertEqual([sample["cycle"] for sample in samples], list(range(201)))
        # 10 ms apart on the wall clock, up to the scheduler.
        self.assertAlmostEqual((samples[-1]["utime"] - samples[0]["utime"]) * 1e-6, 2.0, delta=0.2)


class Log(FolderTest):
    def test_a_run_leaves_a_new_log_in_faultline_logs(self):
        for count in (1, 2, 3):
            self.run_ok("run", "demo.toml")
            self.assertEqual(len(self.folder.logs()), count)
        self.assertTrue(all(os.path.dirname(log) == self.folder.file("faultline-logs") for log in self.folder.logs()))

    def test_the_name_of_a_scenario_cannot_lead_the_log_astray(self):
        self.folder.patch("demo.toml", ('name   = "demo"', 'name   = "../../a/b\\u0000\\n" '))
        self.run_ok("run", "demo.toml")
        (log,) = os.listdir(self.folder.file("faultline-logs"))
        self.assertRegex(log, r"^[\w.-]+\.lcm$")

    def test_no_log(self):
        self.run_ok("run", "demo.toml", "--no-log")
        self.assertFalse(os.path.exists(self.folder.file("faultline-logs")))
        self.assertEqual(self.folder.logs(), [])

    def test_holds_everything_the_run_was_made_from(self):
        self.run_ok("run", "demo.toml", "--log", "own.lcm")
        events, rest = read_log(self.folder.file("own.lcm"))
        self.assertEqual(rest, 0)
        self.assertEqual([event.number for event in events], list(range(len(events))))
        self.assertTrue(all(event.channel == "FAULTLINE_RUN" for event in events[:5]))
        messages = decode_all(events)
        parts = reassemble_parts(messages["FAULTLINE_RUN"])
        for part, name in (("scenario", "demo.toml"), ("plant", "plant.toml"), ("bank_request", "bank.toml"),
                           ("dbc", "bench.dbc")):
            self.assertEqual(parts[part], self.folder.read(name))
        self.assertEqual([residual["name"] for residual in json.loads(parts["bank"])["filters"]], PAIRS)
        self.assert_sequences_without_gaps(messages)
        frames = [frame for batch in messages["FAULTLINE_CAN"] for frame in batch["frames"]]
        self.assertEqual(len(frames), 5005)
        self.assertEqual([sample["cycle"] for sample in messages["FAULTLINE_SAMPLE"]], list(range(1001)))
        self.assertEqual([residual["cycle"] for residual in messages["FAULTLINE_RESIDUAL"]], list(range(1001)))
        isolated = [message for message in messages["FAULTLINE_DIAGNOSIS"] if message["verdict"] == "isolated"]
        self.assertEqual(isolated[0]["sets"], [{"fault_count": 2, "faults": ["u2", "u3"]}])
        self.assertEqual(isolated[0]["cause"], "complete")
        self.assertLessEqual(400, isolated[0]["onset_cycle"])
        self.assertLess(isolated[0]["onset_cycle"], isolated[0]["since_cycle"])
        self.assertEqual(messages["FAULTLINE_DIAGNOSIS"][0]["onset_cycle"], -1)
        estimate = messages["FAULTLINE_ESTIMATE"][-1]
        self.assertEqual((estimate["fault"], estimate["reason"]), (["u2", "u3"], ""))
        for value, deviation, bound in zip(estimate["estimate"], estimate["deviation"], estimate["bound"], strict=True):
            self.assertAlmostEqual(value, 2.0, delta=2e-3)
            self.assertGreater(deviation, 0.0)
            self.assertLess(bound, 0.0)
        truth = [message for message in messages["FAULTLINE_TRUTH"] if message["faults"]]
        self.assertEqual(truth[0]["cycle"], 400)
        self.assertAlmostEqual(estimate["onset_cycle"], truth[0]["cycle"], delta=1)
        self.assertEqual([fault["target"] for fault in truth[0]["faults"]], ["u2", "u3"])
        self.assertEqual(events[-1].channel, "FAULTLINE_STATS")
        stats = messages["FAULTLINE_STATS"][-1]
        self.assertEqual((stats["frames_sent"], stats["frames_received"], stats["frames_dropped"], stats["samples"],
                          stats["late_cycles"]), (5005, 5005, 0, 1001, 0))

    def assert_sequences_without_gaps(self, messages):
        for channel, found in messages.items():
            self.assertEqual([message["sequence"] for message in found], list(range(len(found))), channel)

    def test_a_second_run_replaces_the_log(self):
        self.run_ok("run", "demo.toml", "--log", "own.lcm")
        first = self.folder.read("own.lcm")
        self.folder.patch("demo.toml", ("duration_s = 10.0", "duration_s = 5.0"))
        self.run_ok("run", "demo.toml", "--log", "own.lcm")
        events, rest = read_log(self.folder.file("own.lcm"))
        self.assertLess(len(self.folder.read("own.lcm")), len(first))
        self.assertEqual(rest, 0)
        self.assertEqual(decode(events[-1])["samples"], 501)

    def test_an_empty_file_is_replaced(self):
        self.folder.write("own.lcm", "")
        self.run_ok("run", "demo.toml", "--log", "own.lcm")

    def test_a_file_that_is_no_log_is_never_replaced(self):
        for content in (b"my thesis", b"\xed\xa1\xda", b"\0" * 1000):
            self.folder.write("precious", content)
            answer = self.folder.run("run", "demo.toml", "--log", "precious")
            self.assert_code(2, answer)
            self.assertIn("precious", answer.err)
            self.assertEqual(self.folder.read("precious"), content)


class Info(FolderTest):
    def info(self, name):
        told = self.run_ok("info", name).out
        self.assertIn(name, told)
        return told, json.loads(self.run_ok("info", name, "--json", "-").out)

    def test_plant(self):
        told, data = self.info("plant.toml")
        self.assertIn("hou2015", told)
        self.assertEqual((data["kind"], data["inputs"], data["faults"]), ("plant", FAULTS, FAULTS))

    def test_bank_request(self):
        told, data = self.info("bank.toml")
        self.assertIn("geometric", told)
        self.assertEqual((data["kind"], data["concurrent"], data["sample_time_s"]), ("bank_request", 2, 0.01))

    def test_bank(self):
        self.run_ok("design", "bank.toml", "-o", "pairs.bank.json")
        told, data = self.info("pairs.bank.json")
        for name in PAIRS:
            self.assertIn(name, told)
        self.assertEqual([residual["name"] for residual in data["filters"]], PAIRS)

    def test_scenario(self):
        told, data = self.info("demo.toml")
        self.assertIn("u2", told)
        self.assertEqual((data["kind"], data["duration_s"], data["expectations"]), ("scenario", 10.0, 2))
        self.assertEqual([fault["target"] for fault in data["faults"]], ["u2", "u3"])

    def test_dbc(self):
        told, data = self.info("bench.dbc")
        self.assertIn("SyncCommandCycle", told)
        self.assertEqual([message["id"] for message in data["messages"]], [256, 272, 273, 288, 289])

    def test_dbc_in_latin_1(self):
        self.folder.write("bench.dbc", self.folder.read("bench.dbc").replace(b'] ""', b'] "\xb0C"', 1))
        _, data = self.info("bench.dbc")
        self.assertEqual(data["messages"][0]["signals"][0]["unit"], "°C")

    def test_log(self):
        self.run_ok("run", "demo.toml", "--log", "own.lcm")
        told, data = self.info("own.lcm")
        self.assertIn("isolated u2, u3", told)
        self.assertEqual(data["kind"], "log")
        self.assertEqual(data["undecodable"], 0)
        self.assertEqual(data["channels"]["FAULTLINE_SAMPLE"]["messages"], 1001)
        self.assertTrue(all(channel["missing"] == 0 for channel in data["channels"].values()))
        self.assertEqual([part["part"] for part in data["parts"] if part["complete"]],
                         ["scenario", "plant", "dbc", "bank_request", "bank"])
        self.assertEqual([verdict["verdict"] for verdict in data["verdicts"]], ["inhibited", "healthy", "isolated"])

    def test_a_log_of_others(self):
        self.folder.write("other.lcm", bytes.fromhex("EDA1DA01") + bytes(8) + bytes(8) + b"\0\0\0\x03\0\0\0\x02abc!!")
        _, data = self.info("other.lcm")
        self.assertEqual(data["channels"], {"abc": {"messages": 1, "bytes": 2, "missing": 0}})

    def test_nonsense(self):
        os.mkdir(self.folder.file("folder"))
        self.folder.write("text", "nonsense")
        self.folder.write("short.lcm", b"\xed\xa1")
        self.folder.write("empty.lcm", b"")
        self.folder.write("other.toml", "a = 1\n")
        for name, word in (("text", "LCM"), ("short.lcm", "LCM"), ("empty.lcm", "LCM"),
                           ("other.toml", "other.toml:1:1:"), ("folder", "directory"),
                           ("nosuch", "not exist"), ("nosuch.toml", "not exist")):
            with self.subTest(name=name):
                answer = self.folder.run("info", name)
                self.assert_code(2, answer)
                self.assertIn(name, answer.err)
                self.assertIn(word, answer.err)


class BadInput(FolderTest):
    """Each file wrong in each way: exit 2, FILE:LINE:COLUMN, what was found and what was expected; no log touched."""

    OLD_LOG = bytes.fromhex("EDA1DA01") + bytes(8) + bytes(8) + b"\0\0\0\x03\0\0\0\x03abcold"

    def setUp(self):
        super().setUp()
        self.folder.write("s.toml", without_comments(self.folder.read("demo.toml").decode()))
        self.folder.write("old.lcm", self.OLD_LOG)

    def refuse(self, file, words, *changes, place=None):
        """A run with `changes` to `file` is refused at their mark with `words`. Undoes the changes."""
        before = self.folder.read(file)
        with self.subTest(file=file, changes=changes):
            mark = self.folder.patch(file, *changes) if changes else ""
            place = place or f"{file}:{mark}"
            answer = self.folder.run("run", "s.toml", "--log", "old.lcm")
            self.assert_code(2, answer)
            self.assertIn(place, answer.err)
            for word in words:
                self.assertIn(word, answer.err)
            self.assertEqual(answer.out, "")
            self.assertEqual(self.folder.read("old.lcm"), self.OLD_LOG)
            answer = self.folder.run("run", "s.toml")
            self.assert_code(2, answer)
            self.assertEqual(self.folder.logs(), [self.folder.file("old.lcm")])
        self.folder.write(file, before)

    def test_the_unchanged_files_are_accepted(self):
        self.run_ok("run", "s.toml", "--no-log")

    def test_plant(self):
        last_row = "[2, 0, -4]]"
        for words, old, new in (
                (["TOML"], "schema = 1", "schema = 1 §1"),
                (["TOML"], "[inputs]", "[inputs¶"),
                (["schema", "found 2", "expected 1"], "schema = 1", "schema = §2"),
                (["unknown key", 'did you mean "time"'], "[states]", "§tim = 3\n[states]"),
                (["unknown key", 'did you mean "D"'], "C = [[0, 1, 0]", "§DD = 1\nC = [[0, 1, 0]"),
                (["time", "found nothing", "expected"], 'time   = "continuous"\n', ""),
                (["dynamics.B", "found nothing", "expected a matrix"], "B = [[1, 0, 1, 1],\n     [0, 1, 1, 0],\n     "
                 "[0, 1, 0, 1]]\n", ""),
                (["outputs", "found nothing"], '[outputs]\nnames = ["y1", "y2", "y3"]\n', ""),
                (["found number nan", "finite"], last_row, "[2, §nan, -4]]"),
                (["found number inf", "finite"], last_row, "[2, 0, §inf]]"),
                (["1e400"], last_row, "[2, 0, ¶1e400]]"),
                (["dynamics.A", "row 3", "expected a list of 3 numbers"], last_row, "§[2, 0]]"),
                (["dynamics.A", "found 4 rows", "expected 3 rows"], "A = [", "A = §[[1, 1, 1], "),
                (["found string", "expected a finite number"], last_row, '[2, 0, §"-4"]]'),
                (["found a list", "expected a string"], 'name   = "hou2015"', 'name   = §["hou2015"]'),
                (["found \"y2\" twice"], '["y1", "y2", "y3"]', '§["y1", "y2", "y2"]'),
                (["faults.actuators", '"u9"', "did you mean"], 'actuators = "all"', 'actuators = §["u1", "u9"]'),
                (["nonlinearity, entry 1.slope", "found [0, 1]", "are -1 to 1"], "sensors   = []",
                 'sensors   = []\n[[nonlinearity]]\nfunction = "sin"\nE_o = [1, 0, 0]\nE_i = [1, 0, 0]\n'
                 "slope = §[0, 1]")):
            self.refuse("plant.toml", words, (old, new))

    def test_bank_request(self):
        poles, sample_time = "poles         = [-10.0]", "sample_time_s = 0.01"
        for words, old, new in (
                (["TOML"], "schema = 1", "schema = §= 1"),
                (["unknown key", 'did you mean "concurrent"'], "concurrent    = 2", "concurrent = 2\n§concurent = 2"),
                (["decision", "found nothing", "expected a table"], "[decision]", "[decison]"),
                (["decision.threshold", "found nothing"], "threshold = 0.5\n", ""),
                (["decision.threshold", '"often"', "certified"], "threshold = 0.5", 'threshold = §"often"'),
                (["found number nan"], "threshold = 0.5", "threshold = §nan"),
                (["found 0", "expected"], "dwell     = 3", "dwell     = §0"),
                (["found 99999999999999", "expected"], "settle    = 3", "settle    = §99999999999999"),
                (['"uoi"', '"geometric"', '"uio"'], 'method = "geometric"', 'method = §"uoi"'),
                (["found 10", "negative"], poles, "poles = §[10.0]"),
                (["conjugate"], poles, "poles = §[[-10.0, 1.0]]"),
                (["conjugate"], poles, "poles = §[[-10.0, 1.0], [-10.0, -2.0]]"),
                (["found number -inf"], poles, "poles = [§-inf]"),
                (["found no pole"], poles, "poles = §[]"),
                (["pair [real, imaginary]"], poles, 'poles = [§"fast"]'),
                (["expected a list of 2 numbers"], poles, "poles = [§[-1, 2, 3]]"),
                (["found 4", "4 faults"], "concurrent    = 2", "concurrent    = §4"),
                (["found 0"], "concurrent    = 2", "concurrent    = §0"),
                (["whole number"], "concurrent    = 2", "concurrent    = §2.0"),
                (["found 0", "positive"], sample_time, "sample_time_s = §0.0"),
                (["found -0.01", "positive"], sample_time, "sample_time_s = §-0.01"),
                (["plant", "no file"], '"plant.toml"', '§"nosuch.toml"'),
                (["plant", "no file"], '"plant.toml"', '§"."'),
                (['"d1"', "disturbances"], "normalise     = true", 'decouple = §["d1"]')):
            self.refuse("bank.toml", words, (old, new))

    def test_a_bank_request_for_another_plant(self):
        self.folder.write("other.toml", self.folder.read("plant.toml").replace(b"[2, 0, -4]]", b"[2, 0, -5]]"))
        self.refuse("bank.toml", ["plant", "other.toml", "plant.toml"], ('"plant.toml"', '§"other.toml"'))
        self.folder.write("other.toml", self.folder.read("plant.toml"))
        self.folder.patch("bank.toml", ('"plant.toml"', '"other.toml"'))
        self.run_ok("run", "s.toml", "--no-log")  # another file, the same plant

    def test_scenario(self):
        duration, controller = "duration_s = 10.0", 'kind = "lqr"\nfeedforward = [1.0, 1.0, 1.0, 1.0]'
        gains = "K = [[1, 2, 3], [1, 2, 3], [1, 2, 3], [1, 2, 3]]"
        signals = "seed   = 1\n[signals]\n"
        for words, old, new in (
                (["TOML"], "[controller]", "[controller]]¶"),
                (["unknown key", 'did you mean "seed"'], "seed   = 1", "§sead   = 1"),
                (["unknown key", 'did you mean "controller"'], "[controller]", "¶[controler]"),
                (["duration_s", "found nothing"], duration + "\n", ""),
                (["found 0", "positive"], duration, "duration_s = §0"),
                (["found -1", "positive"], duration, "duration_s = §-1"),
                (["found 1e+30", "at most"], duration, "duration_s = §1e30"),
                (["found 50000000 s", "5000000000 cycles", "expected"], duration, "duration_s = §5e7"),
                (["found number nan"], duration, "duration_s = §nan"),
                (["found number inf"], duration, "duration_s = §inf"),
                (["found string", "number"], duration, 'duration_s = §"10"'),
                (["found string", "whole number"], "seed   = 1", 'seed = §"one"'),
                (["found a list", "a table"], f"[controller]\n{controller}\n", "controller = §[1]\n"),
                (['found "pdi"', '"lqr"'], controller, 'kind = §"pdi"'),
                (["feedforward", "3×1", "4×1"], controller, 'kind = "lqr"\nfeedforward = §[1, 1, 1]'),
                (["feedforward", "found number nan"], controller, 'kind = "lqr"\nfeedforward = [1, §nan, 1, 1]'),
                (["controller.K", "1×3", "4×3"], controller, 'kind = "gain"\nK = §[[1, 2, 3]]'),
                (["controller.K", "row 2"], controller, 'kind = "gain"\nK = [[1, 2, 3], §[1, 2]]'),
                (["controller.K", "found nothing"], controller, 'kind = "gain"'),
                (["unknown key \"Q\""], controller, f'kind = "gain"\n{gains}\n§Q = [[1]]'),
                (["controller.Q", "1×1", "3×3"], controller, 'kind = "lqr"\nQ = §[[1]]'),
                (["controller", "R not positive definite"], f"[controller]\n{controller}",
                 '¶[controller]\nkind = "lqr"\n'
                 "R = [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"),
                (["initial_state", "found 2", "expected 3"], "seed   = 1", "initial_state = §[1, 2]"),
                (['found "cam:vcan0"', "can:IFACE"], "seed   = 1", 'bus = §"cam:vcan0"'),
                (["no file", "nosuch.toml"], '"plant.toml"', '§"nosuch.toml"'),
                (["no file", "nosuch.toml"], '"bank.toml"', '§"nosuch.toml"'),
                (["no file", "nosuch.bank.json"], '"bank.toml"', '§"nosuch.bank.json"'),
                (["no file", "nosuch.dbc"], '"bench.dbc"', '§"nosuch.dbc"'),
                (["folder"], '"plant.toml"', '§"."'),
                (["folder"], '"bank.toml"', '§"."'),
                (["folder"], '"bench.dbc"', '§"."'),
                (["signals", '"y8"', "did you mean"], "seed   = 1", signals + '¶y8 = "Sensors1.y1"'),
                (["scale", "found 0"], "seed   = 1", signals + 'y1 = { signal = "y1", scale = §0 }')):
            self.refuse("s.toml", words, (old, new))

    def test_faults_and_expectations_of_a_scenario(self):
        fault = 'target = "u2"\nkind   = "bias"\nat_s   = 4.0\nvalue  = 2.0'
        expect = 'from_s  = 4.3\nuntil_s = 10.0\nverdict = "isolated"\nfaults  = ["u2", "u3"]'
        for words, old, new in (
                (['"u22"', 'did you mean "u2"'], fault, fault.replace('"u2"', '§"u22"')),
                (['"zzzzzzzz"', "u1, u2, u3, u4, y1, y2, y3"], fault, fault.replace('"u2"', '§"zzzzzzzz"')),
                (['"jammed"', 'bias, gain', 'wrong_crc'], fault, fault.replace('"bias"', '§"jammed"')),
                (["value", "found number inf"], fault, fault.replace("2.0", "§inf")),
                (["at_s", "found -4"], fault, fault.replace("4.0", "§-4")),
                (["value", "found nothing"], f"[[fault]]\n{fault}",
                 "¶[[fault]]\n" + fault.replace("value  = 2.0", "")),
                (["until_s", "more than at_s"], fault, fault + "\nuntil_s = §3.0"),
                (["unknown key", 'did you mean "until_s"'], fault, fault + "\n§untils = 3.0"),
                (["period_s", "positive"], fault, fault + "\nperiod_s = §0"),
                (['"u33"', 'did you mean "u3"'], expect, expect.replace('["u2", "u3"]', '§["u2", "u33"]')),
                (["faults", "empty list"], expect, expect.replace('["u2", "u3"]', "§[]")),
                (["faults", "list of strings"], expect, expect.replace('["u2", "u3"]', "§3")),
                (["faults", "found nothing"], f"[[expect]]\n{expect}",
                 "¶[[expect]]\n" + expect.replace('faults  = ["u2", "u3"]', "")),
                (['"isolatd"', '"isolated"'], expect, expect.replace('"isolated"', '§"isolatd"')),
                (["until_s", "at least from_s"], expect, expect.replace("10.0", "§1.0")),
                (["from_s", "at most duration_s"], expect, expect.replace("4.3", "§20.0").replace("10.0", "30.0"))):
            self.refuse("s.toml", words, (old, new))

    def test_a_run_shorter_than_a_cycle(self):
        text = self.folder.read("s.toml").decode()
        self.folder.write("s.toml", text[:text.index("[[fault]]")])
        self.refuse("s.toml", ["found 0.001", "cycles", "expected"], ("duration_s = 10.0", "duration_s = §0.001"))

    def test_sample_times_beyond_reason(self):
        for value in ("1e-30", "1e-320"):
            before = self.folder.read("bank.toml")
            self.folder.patch("bank.toml", ("sample_time_s = 0.01", f"sample_time_s = {value}"))
            self.refuse("s.toml", ["duration_s", "sample_time_s", "cycles", "expected"],
                        ("duration_s = 10.0", "duration_s = §10.0"))
            self.folder.write("bank.toml", before)
        for value in ("1e30", "1e300"):  # the plant is unstable: it cannot be sampled so slowly
            self.refuse("bank.toml", [f"sampled every {float(value):g} s", "too unstable"],
                        ("sample_time_s = 0.01", f"sample_time_s = {value}"))

    def test_dbc(self):
        y3 = " SG_ y3 : 0|24@1- (0.0001,0)"
        sensors2 = "BO_ 273 Sensors2: 4 Plant"
        role = 'BA_ "FaultlineRole" SG_ 273 Sensors2Cycle 2;'
        for words, old, new in (
                (['found ";"', 'expected ":"'], sensors2, "BO_ 273 Sensors2§; 4 Plant"),
                (["expected"], sensors2, "BO_ 273x ¶Sensors2: 4 Plant"),
                (["4294967296"], sensors2, "BO_ §4294967296 Sensors2: 4 Plant"),
                (["whole number"], sensors2, "BO_ §-3 Sensors2: 4 Plant"),
                (["expected a section"], sensors2, f"§nonsense\n{sensors2}"),
                (["factor 0", "expected"], y3, " SG_ §y3 : 0|24@1- (0,0)"),
                (["factor nan", "expected"], y3, " SG_ §y3 : 0|24@1- (nan,0)"),
                (["factor inf", "finite"], y3, " SG_ §y3 : 0|24@1- (1e999,0)"),
                (["99 bits", "expected 1 to 64"], y3, " SG_ §y3 : 0|99@1- (0.0001,0)"),
                (["y3", "needs 5 bytes", "has 4"], y3, " SG_ §y3 : 10|24@1- (0.0001,0)"),
                (["string"], '[-800|800] "" Controller,Diagnosis\n SG_ Sensors2Cycle',
                 '[-800|800] §3 Controller,Diagnosis\n SG_ Sensors2Cycle')):
            self.refuse("bench.dbc", words, (old, new))
        self.refuse("bench.dbc", ["y3", "multiplexed"], (y3, " SG_ §y3 m0 : 0|24@1- (0.0001,0)"),
                    ("SG_ Sensors2Cycle :", "SG_ Sensors2Cycle M :"))
        self.refuse("bench.dbc", ["Sensors2Cycle", "FaultlineRole", "expected"], (role, role.replace(" 2;", " 9;")),
                    place="bench.dbc:24:6:")

    def test_what_is_odd_in_a_dbc_is_told(self):
        self.folder.patch("bench.dbc", ("BO_ 273 Sensors2: 4 Plant", "BO_ 99999 Sensors2: 4 Plant"),
                          ("SG_ 273 Sensors2Cycle 2;", "SG_ 99999 Sensors2Cycle 2;"))
        self.assertRegex(self.run_ok("run", "demo.toml", "--no-log").out,
                         r"WARNING  .*bench\.dbc:22:5: .*99999.* taken for the extended identifier")

    def test_roles_that_conflict(self):
        self.refuse("bench.dbc", ["second", "role sync", "Sensors2", "Sync"], place="bench.dbc:24:6:", *[
            ("SG_ 273 Sensors2Cycle 2;", "SG_ 273 Sensors2Cycle 1;")])
        self.refuse("bench.dbc", ["two signals of role cycle", "Sensors1"], place="bench.dbc:20:6:", *[
            ("SG_ 272 Sensors1Cycle 2;", 'SG_ 272 Sensors1Cycle 2;\nBA_ "FaultlineRole" SG_ 272 y1 2;')])
        self.refuse("bench.dbc", ["command_cycle", "without role sync"], place="bench.dbc:15:6:", *[
            ('BA_ "FaultlineRole" SG_ 256 SyncCycle 1;\n', "")])

    def test_a_dbc_without_roles(self):
        text = self.folder.read("bench.dbc").decode()
        self.folder.write("bench.dbc", text[:text.index('BA_ "FaultlineRole"')])
        self.refuse("bench.dbc", ["Sensors1", "cycle", "sync", "expected"], ("BO_ 272 Sensors1", "BO_ §272 Sensors1"))

    def test_a_channel_that_the_dbc_lacks(self):
        self.refuse("bench.dbc", ['"y3"', "no signal", '"yy3"'], (" SG_ y3 :", " SG_ yy3 :"),
                    place="bench.dbc:18:6:")  # of three signals one letter away, the first
        self.refuse("plant.toml", ['"y4"', "no signal", '"y1"'], ('["y1", "y2", "y3"]', '["y1", "y2", "y4"]'),
                    place="bench.dbc:18:6:")
        self.refuse("s.toml", ['"y1"', 'no signal "Sensors1.y7"', '"Sensors1.y1"'],
                    ("seed   = 1", 'seed   = 1\n[signals]\ny1 = ¶"Sensors1.y7"'))

    def test_two_messages_with_one_identifier(self):
        self.refuse("bench.dbc", ["Sensors1", "Sensors2", "272"], ("BO_ 273 Sensors2", "BO_ §272 Sensors2"))

    def use_bank_file(self):
        self.run_ok("design", "bank.toml", "-o", "b.bank.json")
        self.folder.patch("s.toml", ('"bank.toml"', '"b.bank.json"'))

    def test_bank_file(self):
        self.use_bank_file()
        for words, old, new in (
                (["JSON"], '"window": 50}', '"window": 50]}¶'),
                (["JSON"], '"dwell": 3', '"dwell": ¶nan'),
                (["JSON"], '"fault_sizes": [1.0,', '"fault_sizes": [¶1e999,'),
                (["found number 7", "expected 1"], '"schema": 1', '"schema": §7'),
                (["unknown key", "requst_digest", "request_digest"], '"request_digest"', '§"requst_digest"'),
                (["sample_time_s", "expected it"], '{\n  "schema": 1,', '§{\n  "schema": 1,'),
                (["found string", "number"], '"sample_time_s": 0.01', '"sample_time_s": §"0.01"'),
                (["found number -0.01", "positive"], '"sample_time_s": 0.01', '"sample_time_s": §-0.01'),
                (["found number 2.5", "whole number"], '"concurrent": 2', '"concurrent": §2.5'),
                (["found a list of 5", "4 values"], '"fault_sizes": [1.0,', '"fault_sizes": §[1.0, 1.0,'),
                (["inputs", "u8", "u1, u2, u3, u4"], '"inputs": ["u1"', '§"inputs": ["u8"'),
                (["digest", "design the bank anew"], '"plant": {"name": "hou2015", "digest": "',
                 '§"plant": {"name": "hou2015", "digest": "9')):
            if "expected it" in words:
                before = self.folder.read("b.bank.json")
                self.folder.patch("b.bank.json", ('  "sample_time_s": 0.01,\n', ""))
                self.refuse("b.bank.json", words, (old, new))
                self.folder.write("b.bank.json", before)
            else:
                self.refuse("b.bank.json", words, (old, new))

    def test_a_bank_file_with_faults_of_its_own(self):
        self.use_bank_file()
        text = self.folder.read("b.bank.json").decode().replace('"u4"', '"u9"')
        self.folder.write("b.bank.json", text.replace('"u9"', '"u4"', 1))  # that one is the input
        self.refuse("b.bank.json", ["faults", "u1, u2, u3, u9", "u1, u2, u3, u4"],
                    ('\n  "faults": [', '\n  §"faults": ['))

    def test_a_bank_file_for_another_plant(self):
        self.use_bank_file()
        self.folder.patch("plant.toml", ("[2, 0, -4]]", "[2, 0, -5]]"))
        self.refuse("b.bank.json", ["digest", '"hou2015"', "plant.toml", "design the bank anew"],
                    ('"plant": {', '§"plant": {'))

    def test_empty_files_and_binary_garbage(self):
        garbage = random.Random(1).randbytes(2000)
        for file in ("s.toml", "plant.toml", "bank.toml", "bench.dbc", "b.bank.json"):
            if file == "b.bank.json":
                self.use_bank_file()
            before = self.folder.read(file)
            for content in (b"", b"\0" * 100, garbage, b"\xff\xfe" + "schema = 1\n".encode("utf-16-le"), b"[" * 100000):
                self.folder.write(file, content)
                self.refuse(file, [], place=f"{file}:1:")
            self.folder.write(file, before)

    def test_files_that_are_not_there(self):
        os.mkdir(self.folder.file("folder.toml"))
        for command in ("run", "design", "info"):
            for name in ("nosuch.toml", "folder.toml", "s.toml/x.toml", ""):
                answer = self.folder.run(command, name)
                self.assert_code(2, answer)
                self.assertIn(name, answer.err)
        self.assertEqual(self.folder.logs(), [self.folder.file("old.lcm")])


class Failures(FolderTest):
    """A bus, a file or LCM that fails: exit 3."""

    def fail(self, *arguments):
        answer = self.folder.run("run", "demo.toml", *arguments)
        self.assert_code(3, answer)
        return answer.err

    def test_an_interface_that_does_not_exist(self):
        err = self.fail("--bus", "can:nosuch0")
        self.assertIn("can:nosuch0", err)
        self.assertRegex(err, "with-vcan|ip link|modprobe")  # what to do
        self.assertEqual(self.folder.logs(), [])

    def test_an_interface_with_an_impossible_name(self):
        self.assertIn("can:", self.fail("--bus", "can:" + "x" * 300))

    def test_an_unwritable_log(self):
        for log in ("nosuch/own.lcm", ".", "/proc/own.lcm", "x" * 300):
            self.assertIn(log, self.fail("--log", log))

    def test_a_full_disk(self):
        err = self.fail("--log", "/dev/full")
        self.assertIn("/dev/full", err)
        self.assertIn("No space left", err)
        self.assertIn("No space left", self.fail("--log", "/dev/full", "--realtime"))

    def test_a_folder_that_is_read_only(self):
        self.folder.write("faultline-logs", "in the way")
        self.assertIn("faultline-logs", self.fail())
        if os.geteuid() == 0:  # permissions do not bind root: run it as somebody else
            prefix = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
        else:
            prefix = []
        os.mkdir(self.folder.file("locked"))
        for file in os.listdir(EXAMPLE):
            if os.path.isfile(f"{EXAMPLE}/{file}"):
                shutil.copy(f"{EXAMPLE}/{file}", self.folder.file("locked"))
        copy = shutil.copy(program(), self.folder.file("faultline"))  # nobody may not be able to read the build tree
        os.chmod(copy, 0o755)
        os.chmod(self.folder.path, 0o755)
        os.chmod(self.folder.file("locked"), 0o555)
        try:
            process = subprocess.Popen([*prefix, copy, "run", "demo.toml"], cwd=self.folder.file("locked"),
                                       env={**self.folder.environment, "XDG_CACHE_HOME": "/proc/nosuch"},
                                       stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            answer = finish(process)
        finally:
            os.chmod(self.folder.file("locked"), 0o755)
        self.assert_code(3, answer)
        self.assertIn("faultline-logs", answer.err)
        self.assertIn("Permission denied", answer.err)

    def test_a_bad_lcm_url_leaves_the_old_log_alone(self):
        self.folder.write("own.lcm", BadInput.OLD_LOG)
        answer = self.folder.run("run", "demo.toml", "--lcm", "nonsense://x", "--log", "own.lcm")
        self.assert_code(2, answer)
        self.assertIn("nonsense://x", answer.err)
        self.assertIn("udpm://", answer.err)
        self.assertEqual(self.folder.read("own.lcm"), BadInput.OLD_LOG)

    def test_unwritable_data(self):
        for target in ("nosuch/run.json", "/dev/full"):
            self.assertIn(target, self.fail("--json", target))

    def test_a_full_stdout(self):
        with open("/dev/full", "w") as full:
            for arguments in (["run", "demo.toml", "--no-log"], ["run", "demo.toml", "--no-log", "--json", "-"],
                              ["info", "plant.toml"], ["design", "bank.toml"]):
                self.assert_code(3, self.folder.run(*arguments, stdout=full))

    def test_a_full_stderr_does_not_stop_a_run(self):
        with open("/dev/full", "w") as full:
            self.assert_code(0, self.folder.run("run", "demo.toml", stderr=full))

    def test_a_reader_that_leaves_early(self):
        for arguments in (["info", "plant.toml"], ["run", "demo.toml", "--json", "-"], ["design", "bank.toml"]):
            process = self.folder.start(*arguments)
            process.stdout.close()
            process.stdout = None
            self.assertIn(finish(process).code, (0, 3), arguments)

    def test_closed_standard_streams_do_not_end_up_in_the_log(self):
        def close_all():
            for stream in (0, 1, 2):
                os.close(stream)

        process = subprocess.Popen([program(), "run", "demo.toml", "--log", "own.lcm"], cwd=self.folder.path,
                                   env=self.folder.environment, preexec_fn=close_all)
        self.assertEqual(process.wait(30), 0)
        events, rest = read_log(self.folder.file("own.lcm"))
        self.assertEqual((events[-1].channel, rest), ("FAULTLINE_STATS", 0))


class Interruption(FolderTest):
    def start_long_run(self, *arguments):
        self.folder.patch("demo.toml", ("duration_s = 10.0", f"duration_s = {LONG_S}"))
        process = self.folder.start("run", "demo.toml", "--log", "own.lcm", *arguments)
        self.addCleanup(lambda: process.poll() is None and process.kill())
        wait_for(lambda: os.path.exists(self.folder.file("own.lcm"))
                 and os.path.getsize(self.folder.file("own.lcm")) > 50_000)
        return process

    def test_a_signal_stops_the_run_cleanly(self):
        for number, arguments in ((signal.SIGINT, []), (signal.SIGTERM, []),
                                  (signal.SIGINT, ["--realtime"]), (signal.SIGTERM, ["--realtime"])):
            with self.subTest(signal=number, arguments=arguments):
                shutil.copy(f"{EXAMPLE}/demo.toml", self.folder.path)
                self.folder.write("own.lcm", b"")
                process = self.start_long_run("--json", "run.json", *arguments)
                begin = time.monotonic()
                process.send_signal(number)
                answer = finish(process)
                self.assertLess(time.monotonic() - begin, STOP_WITHIN_S)
                self.assert_code(128 + number, answer)
                self.assertIn("demo on loop", answer.out)
                self.assertIn(f"STOPPED by signal {int(number)}", answer.out)
                self.assertIs(json.loads(self.folder.read("run.json"))["interrupted"], True)
                events, rest = read_log(self.folder.file("own.lcm"))
                self.assertEqual((events[-1].channel, rest), ("FAULTLINE_STATS", 0))
                self.assertEqual([event.number for event in events], list(range(len(events))))
                messages = decode_all(events)
                for channel, found in messages.items():
                    self.assertEqual([message["sequence"] for message in found], list(range(len(found))), channel)
                cycles = [sample["cycle"] for sample in messages["FAULTLINE_SAMPLE"]]
                self.assertEqual(cycles, list(range(len(cycles))))
                self.assertEqual(messages["FAULTLINE_STATS"][-1]["samples"], len(cycles))
                self.assertIn("signal", messages["FAULTLINE_EVENT"][-1]["text"])

    def test_a_second_signal_does_no_harm(self):
        process = self.start_long_run()
        for _ in range(3):
            process.send_signal(signal.SIGINT)
        self.assertIn(finish(process).code, (130, -signal.SIGINT))
        events, rest = read_log(self.folder.file("own.lcm"))
        self.assertEqual((events[-1].channel, rest), ("FAULTLINE_STATS", 0))

    def assert_readable(self, name):
        events, _ = read_log(self.folder.file(name))
        messages = decode_all(events)
        self.assertGreater(len(messages["FAULTLINE_SAMPLE"]), 10)
        for channel, found in messages.items():
            self.assertEqual([message["sequence"] for message in found], list(range(len(found))), channel)
        self.assertEqual(reassemble_parts(messages["FAULTLINE_RUN"])["scenario"], self.folder.read("demo.toml"))
        data = json.loads(self.run_ok("info", name, "--json", "-").out)
        self.assertEqual(data["messages"], len(events))
        self.assertEqual(data["undecodable"], 0)
        return messages

    def test_a_killed_run_in_lock_step_leaves_a_readable_log(self):
        process = self.start_long_run()
        process.kill()
        self.assertEqual(finish(process).code, -signal.SIGKILL)
        self.assert_readable("own.lcm")

    def test_a_killed_run_in_real_time_loses_a_tenth_of_a_second(self):
        # Three tries: the bound is the program's, not the scheduler's of a busy machine.
        losses_s = []
        for _ in range(3):
            shutil.copy(f"{EXAMPLE}/demo.toml", self.folder.path)
            self.folder.write("own.lcm", b"")
            process = self.start_long_run("--realtime")
            time.sleep(0.3)
            killed_s = time.time()
            process.kill()
            self.assertEqual(finish(process).code, -signal.SIGKILL)
            messages = self.assert_readable("own.lcm")
            losses_s.append(killed_s - messages["FAULTLINE_SAMPLE"][-1]["utime"] * 1e-6)
            if losses_s[-1] <= 0.1:
                break
        self.assertLessEqual(min(losses_s), 0.1)


class HostileInput(FolderTest):
    """Random damage to each kind of file: an answer, never a crash, never a hang."""

    COUNT = 300
    HANG_S = 10.0
    NUMBERS = ["0", "-1", "1e30", "-1e30", "1e300", "1e-300", "1e999", "nan", "inf", "-inf", "9223372036854775807",
               "18446744073709551616", "4294967296", "2147483648", "-2147483649", "0.1", "3", "1e5", "NaN", "0x7f"]

    @staticmethod
    def mutate(text, seed):
        """One to four random changes of `text`, a function of `seed`."""
        chance = random.Random(seed)
        data = bytearray(text)
        for _ in range(chance.randint(1, 4)):
            lines = bytes(data).splitlines(keepends=True) or [b"\n"]
            at, line = chance.randrange(len(data) + 1), chance.randrange(len(lines))
            kind = chance.randrange(8)
            if kind == 0 and at < len(data):  # one bit
                data[at] ^= 1 << chance.randrange(8)
            elif kind == 1:  # one byte
                data[at:at + 1] = bytes([chance.randrange(256)])
            elif kind == 2:  # a stretch is lost
                del data[at:at + chance.randint(1, 20)]
            elif kind == 3:  # a line is lost
                data = bytearray(b"".join(lines[:line] + lines[line + 1:]))
            elif kind == 4:  # a line twice, or elsewhere
                data = bytearray(b"".join(lines[:line] + [lines[chance.randrange(len(lines))]] + lines[line:]))
            elif kind == 5:  # the end is lost
                del data[at:]
            else:  # a number is another
                found = list(re.finditer(rb"-?\d+(\.\d+)?", bytes(data)))
                if found:
                    number = chance.choice(found)
                    data[number.start():number.end()] = chance.choice(HostileInput.NUMBERS).encode()
        return bytes(data)

    def try_one(self, folder, file, seed, *arguments):
        original = folder.read(file)
        folder.write(file, self.mutate(original, seed))
        try:
            process = folder.start(*arguments)
            try:
                code = finish_quietly(process, self.HANG_S)
            except subprocess.TimeoutExpired:
                # A run may have become a long one; then it can be stopped, and a hang cannot.
                process.send_signal(signal.SIGINT)
                code = finish_quietly(process, STOP_WITHIN_S)
                code = 0 if code == 130 else "hangs"
            return [] if code in (0, 1, 2) else [f"{file}, seed {seed}: {code}"]
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return [f"{file}, seed {seed}: hangs"]
        finally:
            folder.write(file, original)

    def attack(self, file, *arguments):
        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            folders = [self.prepare() for _ in range(2)]

            def work(i):
                return [fault for seed in range(i, self.COUNT, len(folders))
                        for fault in self.try_one(folders[i], file, seed, *arguments)]

            faults = [fault for found in pool.map(work, range(len(folders))) for fault in found]
        self.assertEqual(faults, [], "of exit codes 0, 1 and 2")

    def prepare(self):
        folder = Folder()
        self.addCleanup(folder.remove)
        # Short runs: what is under test is how the files are read.
        text = re.sub(r"duration_s = \S+", "duration_s = 0.2", folder.read("demo.toml").decode())
        text = re.sub(r"at_s   = \S+", "at_s   = 0.1", text)
        text = re.sub(r"from_s  = \S+", "from_s  = 0.1", re.sub(r"until_s = \S+", "until_s = 0.2", text))
        folder.write("s.toml", without_comments(text))
        assert folder.run("design", "bank.toml", "-o", "b.bank.json").code == 0
        folder.write("b.toml", folder.read("s.toml").replace(b'"bank.toml"', b'"b.bank.json"'))
        return folder

    def test_plant(self):
        self.attack("plant.toml", "run", "s.toml", "--no-log")

    def test_bank_request(self):
        self.attack("bank.toml", "run", "s.toml", "--no-log")

    def test_scenario(self):
        self.attack("s.toml", "run", "s.toml", "--no-log")

    def test_dbc(self):
        self.attack("bench.dbc", "run", "s.toml", "--no-log")

    def test_bank_file(self):
        self.attack("b.bank.json", "run", "b.toml", "--no-log")

    def test_a_plant_that_is_scaled_badly(self):
        self.folder.patch("plant.toml", ("[2, 0, -4]]", "[2, 0, 54]]"), ("C = [[0, 1, 0]", "C = [[2147483648, 1, 0]"))
        self.assertIn(self.folder.run("design", "bank.toml", patience_s=self.HANG_S).code, (0, 1, 2))

    def test_log(self):
        self.run_ok("run", "demo.toml", "--log", "own.lcm")
        log = self.folder.read("own.lcm")[:40_000]
        for seed in range(100):
            self.folder.write("own.lcm", log)
            self.assertEqual(self.try_one(self.folder, "own.lcm", seed, "info", "own.lcm", "--json", "-"), [])


def finish_quietly(process, patience_s):
    process.communicate(timeout=patience_s)
    return process.returncode


if __name__ == "__main__":
    unittest.main()
