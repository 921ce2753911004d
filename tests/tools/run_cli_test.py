#!/usr/bin/python3
"""`faultline run`: results, expectations, progress, the bank's cache, real time, and the log that a run leaves."""
import json
import os
import time
import unittest

from faultline_program import FolderTest, decode, decode_all, read_log, reassemble_parts

PAIRS = ["r12", "r13", "r14", "r23", "r24", "r34"]
# Without x1 among the outputs, pairs of faults have no solution.
UNSOLVABLE = [("     [1, 0, 2]]", "     [0, 0, 2]]")]


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


if __name__ == "__main__":
    unittest.main()
