#!/usr/bin/python3
"""Certified, sequential and calibrated thresholds from the command line, on the example in examples/hou2015/thresholds."""
import json
import os
import shutil
import unittest

from faultline_program import ROOT, FolderTest


class Thresholds(FolderTest):
    def setUp(self):
        super().setUp()
        shutil.copytree(f"{ROOT}/examples/hou2015/thresholds", self.folder.file("t"))
        shutil.copy(f"{ROOT}/examples/hou2015/bench.dbc", self.folder.file("bench.dbc"))

    def edit(self, name, old, new):
        text = self.folder.read(name).decode()
        self.assertIn(old, text)
        self.folder.write(name, text.replace(old, new))

    def test_the_drift_is_found_by_the_tests_and_by_nothing_else(self):
        said = self.run_ok("run", "t/drift.toml", "t/drift_unseen.toml", "--no-log").out
        self.assertIn("2 scenarios: 2 met", said)

    def test_tests_begin_anew_after_the_start(self):
        # Residuals forget the start in 9 s. What it left must not have added up: with a reference as small as this it would
        # take minutes to clear.
        self.edit("t/cusum.toml", 'test   = "cusum"', 'test   = "cusum"\ntuned_for = 0.01')
        self.edit("t/drift.toml", "seed   = 1", "seed   = 1\ninitial_state = [5.0, -5.0, 5.0]")
        self.run_ok("run", "t/drift.toml", "--no-log")

    def test_a_run_with_tests_is_reproduced_and_reported(self):
        self.run_ok("run", "t/drift.toml", "--log", "drift.lcm", "--report", "drift.html")
        self.assertIn("VERIFIED: reproduced to the bit", self.run_ok("replay", "drift.lcm", "--verify").out)
        page = self.folder.read("drift.html").decode()
        self.assertIn("evaluated by a CUSUM test", page)
        self.assertIn("0.01 false alarms an hour by noise", page)
        # What is shown beside the threshold is the statistic, not the residual.
        self.assertNotIn("Largest |r|", page)

    def test_a_certified_bank_says_what_its_thresholds_are_made_of(self):
        said = self.run_ok("design", "t/comparison.toml", "-o", "c.bank.json").out
        self.assertIn("certified thresholds: what a row can be without a fault", said)
        self.assertIn("one in 100 hours", said)
        self.assertIn("every claim holds", self.run_ok("check", "c.bank.json", "--plant", "t/plant.toml").out)
        self.assertIn("certified thresholds", self.run_ok("info", "c.bank.json").out)
        # Another plant, less noise: the claims are others.
        self.edit("t/plant.toml", "sigma  = 0.02", "sigma  = 0.03")
        answer = self.folder.run("check", "c.bank.json", "--plant", "t/plant.toml")
        self.assert_code(1, answer)
        self.assertIn("componentwise threshold", answer.out + answer.err)

    def test_coarser_signals_than_the_thresholds_reckon_with_are_told(self):
        self.edit("t/comparison.toml", "y2 = 0.0001", "y2 = 0.00001")
        answer = self.folder.run("run", "t/drift_unseen.toml", "--no-log")
        self.assert_code(0, answer)
        self.assertIn("y2 is rounded to 0.0001 on the bus", answer.out + answer.err)

    def test_rounding_counts_for_observers_too(self):
        shutil.copy(f"{ROOT}/examples/ma2024/plant.toml", self.folder.file("plant.toml"))
        with open(f"{ROOT}/examples/ma2024/bank.toml", encoding="utf-8") as file:
            text = file.read()
        self.folder.write("bank.toml", text.replace("[decision]\n", "[decision]\nresolution = { y1 = 0.01, y2 = 0.01 }\n"))
        self.run_ok("design", "bank.toml", "-o", "o.bank.json")
        self.assertIn("every claim holds", self.run_ok("check", "o.bank.json", "--plant", "plant.toml").out)
        # The claims are those of rounded outputs: with finer ones they are not true.
        bank = self.folder.read("o.bank.json").decode()
        self.folder.write("finer.bank.json", bank.replace('"output_resolution": [0.01,', '"output_resolution": [0.001,'))
        answer = self.folder.run("check", "finer.bank.json", "--plant", "plant.toml")
        self.assert_code(1, answer)
        self.assertIn("componentwise threshold", answer.out + answer.err)
        for key in ("jitter_s = 0.001", "false_alarms_per_h = 1"):
            self.folder.write("bank.toml", text.replace("[decision]\n", f"[decision]\n{key}\n"))
            answer = self.folder.run("design", "bank.toml", "-o", "x.bank.json")
            self.assert_code(2, answer)
            self.assertIn("method \"uio\" takes bounds", answer.err)

    def test_calibrated_thresholds(self):
        said = self.run_ok("design", "t/calibrated.toml", "-o", "p.bank.json").out
        self.assertIn("NOT CALIBRATED", said)
        self.edit("t/fault_free.toml", "duration_s = 3600.0", "duration_s = 1200.0")
        answer = self.folder.run("run", "t/fault_free.toml", "--log", "free.lcm")
        self.assert_code(0, answer)
        self.assertIn("are provisional", answer.out + answer.err)
        said = self.run_ok("calibrate", "free.lcm", "--far", "30/h", "-o", "c.bank.json", "--json", "c.json").out
        self.assertIn("calibrated thresholds", said)
        found = json.loads(self.folder.read("c.json"))
        self.assertEqual(found["false_alarms_per_h"], 30.0)
        for one in found["residuals"]:
            low, high = one["interval_per_h"]
            self.assertLess(low, 5.0)
            self.assertGreater(high, 5.0)
            self.assertAlmostEqual(one["false_alarms_per_h"], 5.0)
        self.assertIn("every claim holds", self.run_ok("check", "c.bank.json", "--plant", "t/plant.toml").out)
        # It can be used, and given a number of its own.
        self.edit("t/drift.toml", '"cusum.toml"', '"../c.bank.json"')
        self.edit("t/drift.toml", "value  = 0.1", "value  = 2.0")
        self.run_ok("run", "t/drift.toml", "--no-log")

    def test_what_cannot_be_calibrated(self):
        self.edit("t/fault_free.toml", "duration_s = 3600.0", "duration_s = 600.0")
        self.run_ok("run", "t/fault_free.toml", "--log", "free.lcm")
        self.run_ok("run", "t/drift_unseen.toml", "--log", "fault.lcm")
        self.folder.write("text.lcm", "no log\n")
        for arguments, text in (
                (["free.lcm", "--far", "10"], "--far: found \"10\", expected a positive number per time"),
                (["free.lcm", "--far", "0/h"], "--far: found \"0/h\""),
                (["free.lcm", "--far", "nan/h"], "--far: found \"nan/h\""),
                (["free.lcm", "--far", "-1/h"], "--far: found \"-1/h\""),
                (["free.lcm", "--far", "1e-6/h"], "h are fitted: they carry"),
                (["fault.lcm", "--far", "10/h"], "found fault \"u2\" (bias) acting in cycle 2000"),
                (["fault.lcm", "--far", "10/h", "--bank", "t/plant.toml"], "t/plant.toml"),
                (["text.lcm", "--far", "10/h"], "text.lcm"),
                (["free.lcm", "--far", "10/h", "--plant", f"{ROOT}/examples/hou2015/stable_plant.toml"], "is for plant")):
            with self.subTest(arguments=arguments):
                answer = self.folder.run("calibrate", *arguments, "-o", "x.bank.json")
                self.assert_code(2, answer)
                self.assertIn(text, answer.err)
                self.assertFalse(os.path.exists(self.folder.file("x.bank.json")))
        self.run_ok("design", "t/comparison.toml", "-o", "c.bank.json")
        answer = self.folder.run("calibrate", "free.lcm", "--far", "10/h", "--bank", "c.bank.json", "-o", "x.json")
        self.assert_code(2, answer)
        self.assertIn("proved from bounds and need no record", answer.err)


if __name__ == "__main__":
    unittest.main()
