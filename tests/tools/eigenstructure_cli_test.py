#!/usr/bin/python3
"""Eigenstructure assignment as a user meets it: examples/jin, what `design` prints of it, the unknown inputs of a
record, and what is refused."""
import csv
import json
import os
import shutil
import unittest

from faultline_program import ROOT, FolderTest

JIN = f"{ROOT}/examples/jin"


class JinTest(FolderTest):
    def setUp(self):
        super().setUp()
        shutil.copytree(JIN, self.folder.file("jin"))

    def design(self, name, code=0):
        answer = self.folder.run("design", f"jin/{name}.toml", "-o", "out.bank.json", "--json", "design.json")
        self.assert_code(code, answer)
        return answer, json.loads(self.folder.read("design.json"))


class Examples(JinTest):
    def test_every_scenario_meets_its_expectations(self):
        answer = self.run_ok("run", "jin", "--no-log", "--json", "suite.json")
        self.assertIn("healthy", answer.out)

    def test_says_how_the_friction_is_kept_out(self):
        answer, design = self.design("bank")
        self.assertIn("how unknown inputs are kept out", answer.out)
        self.assertEqual([item["assignment"] for item in design["assignments"]], ["right", "right", "left"])
        self.assertEqual([item["rank_CE"] for item in design["assignments"]], [1, 1, 0])
        for item in design["assignments"]:
            self.assertLess(item["rank_CW"], item["rank_C"])
        self.run_ok("check", "out.bank.json", "--plant", "jin/plant.toml")

    def test_a_bank_that_weakens_is_certified_too(self):
        answer, design = self.design("bank_weakened")
        weakening = design["assignments"][0]["weakening"]
        self.assertEqual(weakening["criterion"], "worst_case")
        self.assertLess(weakening["ratio_after"], weakening["ratio_before"])
        self.assertEqual([trial["rows"] for trial in weakening["trade_off"]], [1])
        self.assertNotIn("weakening", design["assignments"][2])  # r3 can do without
        self.assertIn("to the fault", answer.out)
        bank = json.loads(self.folder.read("out.bank.json"))
        self.assertEqual(bank["disturbances"], [{"name": "friction", "treatment": "decoupled"},
                                                {"name": "motor_friction", "treatment": "weakened"}])
        self.run_ok("check", "out.bank.json", "--plant", "jin/plant.toml")

    def test_the_papers_examples_have_their_corrected_numbers(self):
        answer, _ = self.design("paper/example1", code=1)
        self.assertIn("no residual of any kind", answer.out)
        _, design = self.design("paper/example2")
        (item,) = design["assignments"]
        self.assert_row(item["W"], (-0.67078, 0.74166))
        self.assertAlmostEqual(item["weakening"]["singular_values"][0], 1.7954568557975594, 10)
        _, design = self.design("paper/example3")
        (item,) = design["assignments"]
        self.assertEqual((item["assignment"], item["dynamic_weights"], item["static_weights"]), ("static", 0, 1))
        self.assert_row(item["W"], (1, 1, -1))
        _, design = self.design("paper/example4")
        (item,) = design["assignments"]
        self.assert_row(item["W"], (-0.68186, 0.73148))
        self.assertAlmostEqual(item["weakening"]["approximated"], 1.7954568557975594, 10)
        self.assertAlmostEqual(item["weakening"]["singular_values"][1], 4.96081324102237, 10)

    def assert_row(self, W, expected):
        (row,) = W
        size = sum(value * value for value in expected) ** 0.5
        sign = 1 if row[0] * expected[0] > 0 else -1
        for value, other in zip(row, expected, strict=True):
            self.assertAlmostEqual(sign * value, other / size, 4)

    def test_refuses_what_cannot_be_asked(self):
        for old, new, expected in (
                ('decouple      = ["friction"]', 'decouple      = ["frition"]', 'did you mean "friction"?'),
                ("poles         = [-50, -55, -60, -65]", "poles = [-50, 0, -60, -65]", "dead-beat, 0, is stable in the sampled"),
                ("poles         = [-50, -55, -60, -65]", "poles = [-50, 55, -60, -65]", "did you mean -55?"),
                ("poles         = [-50, -55, -60, -65]", "poles = [[-50, 3], -60, -65]", "conjugate"),
                ("[decision]", "[eigenstructure]\nassignment = \"up\"\n[decision]", '"best"'),
                ("[decision]", "[eigenstructure]\nweaken = [\"friction\"]\n[decision]", "twice")):
            with self.subTest(new=new):
                shutil.copy(f"{JIN}/bank.toml", self.folder.file("jin/bank.toml"))
                self.folder.patch("jin/bank.toml", (old, new))
                answer = self.folder.run("design", "jin/bank.toml")
                self.assert_code(2, answer)
                self.assertIn(expected, answer.err)

    def test_what_was_demanded_and_cannot_be_had_is_explained(self):
        self.folder.patch("jin/bank.toml", ("[decision]", "[eigenstructure]\nassignment = \"left\"\n[decision]"))
        answer, design = self.design("bank", code=1)
        self.assertIn("no left eigenvectors", answer.out)
        self.assertEqual([item["exists"] for item in design["residuals"]], [False, False, True])


class Uncertainty(JinTest):
    RUN = ("run", "jin/i.toml", "--log", "a.lcm", "--json", "a.json")

    def samples(self, log, folder):
        self.run_ok("log", "export", log, "-o", folder, "--channel", "SAMPLE")
        with open(self.folder.file(f"{folder}/sample.csv"), newline="") as file:
            return [(row["i"], row["w_motor"], row["w_load"], row["u"]) for row in csv.DictReader(file)]

    def test_simulates_the_plant_that_the_file_with_the_parameter_changed_says(self):
        self.run_ok(*self.RUN)
        uncertain = self.samples("a.lcm", "a")
        # -2 - 100 * 0.02 in the file itself, and no uncertainty in the run.
        self.folder.patch("jin/plant.toml", ("100,   -2]]", "100,   -4]]"))
        self.folder.patch("jin/common.toml", ("friction = 1.0 ", "friction = 0.0 "))
        self.folder.run("run", "jin/i.toml", "--log", "b.lcm")
        self.assertEqual(self.samples("b.lcm", "b"), uncertain)
        self.assertGreater(len(uncertain), 10000)

    def test_refuses_places_that_are_none(self):
        for value, expected in (("1.5", "-1 to 1"), ("[0.5, 0.5]", "found 2 numbers, expected 1"), ("nan", "nan")):
            with self.subTest(value=value):
                shutil.copy(f"{JIN}/common.toml", self.folder.file("jin/common.toml"))
                self.folder.patch("jin/common.toml", ("friction = 1.0 ", f"friction = {value} "))
                answer = self.folder.run("run", "jin/i.toml", "--no-log")
                self.assert_code(2, answer)
                self.assertIn("uncertainty", answer.err)
                self.assertIn(expected, answer.err)
        shutil.copy(f"{JIN}/common.toml", self.folder.file("jin/common.toml"))
        self.folder.patch("jin/common.toml", ("friction = 1.0 ", "fricton = 1.0 "))
        answer = self.folder.run("run", "jin/i.toml", "--no-log")
        self.assert_code(2, answer)
        self.assertIn('did you mean "friction"?', answer.err)


class UnknownInputs(JinTest):
    """The friction from a record, by a plant file that knows nothing of it."""

    def setUp(self):
        super().setUp()
        # The drive shakes the load, so that its friction shows in no other state.
        self.folder.write("jin/shaken.toml", """
schema = 1
name   = "shaken"
plant  = "plant.toml"
bank   = "bank.toml"
dbc    = "bench.dbc"
duration_s = 20.0
[simulation.uncertainty]
friction = 1.0
[controller]
kind = "none"
amplitude    = [20.0]
frequency_Hz = [7.0]
[[noise]]
target = "all"
kind   = "gaussian"
""")
        text = self.folder.read("jin/plant.toml").decode()
        begin, end = text.index("[[uncertainty]]"), text.index("[[noise]]")  # both
        self.folder.write("ignorant.toml", text[:begin] + text[end:])

    def test_finds_the_state_that_the_friction_acts_on(self):
        self.run_ok("run", "jin/shaken.toml", "--log", "a.lcm")
        self.run_ok("unknown-inputs", "ignorant.toml", "a.lcm", "-o", "found.toml", "--json", "found.json")
        found = json.loads(self.folder.read("found.json"))
        self.assertEqual(found["rank"], 1)
        self.assertGreater(found["innovation_before"], 1.3)
        state = found["unknown_inputs"][0]["state"]
        self.assertGreater(abs(state[3]), 0.95)
        self.assertLess(found["halves_deg"], 20)
        # What was written is a plant file that the design takes.
        self.run_ok("info", "found.toml")
        self.folder.patch("jin/bank.toml", ('"plant.toml"', '"../found.toml"'), ('["friction"]', '["recorded1"]'))
        self.design("bank")

    def test_finds_nothing_where_nothing_acts(self):
        self.folder.patch("jin/shaken.toml", ("friction = 1.0", "friction = 0.0"))
        self.run_ok("run", "jin/shaken.toml", "--log", "a.lcm")
        answer = self.folder.run("unknown-inputs", "ignorant.toml", "a.lcm")
        self.assert_code(1, answer)
        self.assertIn("the plant's noise explains the record", answer.out)

    def test_refuses_records_that_do_not_tell(self):
        self.run_ok("run", "jin/i.toml", "--log", "fault.lcm")
        self.folder.patch("jin/shaken.toml", ("duration_s = 20.0", "duration_s = 0.1"))
        self.run_ok("run", "jin/shaken.toml", "--log", "short.lcm")
        self.folder.write("text.lcm", "no log")
        for log, expected in (("fault.lcm", 'found fault "i" (bias)'), ("short.lcm", "expected at least 200"),
                              ("text.lcm", "LCM"), ("missing.lcm", "missing.lcm")):
            with self.subTest(log=log):
                answer = self.folder.run("unknown-inputs", "ignorant.toml", log, "-o", "never.toml")
                self.assert_code(2, answer)
                self.assertIn(expected, answer.err)
                self.assertFalse(os.path.exists(self.folder.file("never.toml")))
        answer = self.folder.run("unknown-inputs", "plant.toml", "short.lcm")
        self.assert_code(2, answer)
        self.assertIn("expected 3 and 4", answer.err)


if __name__ == "__main__":
    unittest.main()
