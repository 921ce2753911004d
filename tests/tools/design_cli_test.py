#!/usr/bin/python3
"""`faultline design` as a user meets it: what it prints, gives as data, writes and refuses."""
import json
import os
import unittest

from faultline_program import FolderTest

FAULTS = ["u1", "u2", "u3", "u4"]
PAIRS = ["r12", "r13", "r14", "r23", "r24", "r34"]
# Without x1 among the outputs, pairs of faults have no solution.
UNSOLVABLE = [("     [1, 0, 2]]", "     [0, 0, 2]]")]
# Something unknown adds to the first sensor.
OFFSET = [("[faults]", "[[disturbance]]\nname = \"offset\"\noutput = [1, 0, 0]\n\n[faults]")]


class Design(FolderTest):
    KEYS = {"name", "decouples", "exists", "dim_w", "dim_s", "projector_w", "projector_s", "quotient_dim", "rows",
            "responds_to", "transient_only", "margins", "dc_gain", "poles", "certificate"}

    def test_writes_a_bank_beside_its_request(self):
        answer = self.run_ok("design", "bank.toml")
        self.assertIn("bank.bank.json", answer.out)
        bank = json.loads(self.folder.read("bank.bank.json"))
        self.assertEqual([residual["name"] for residual in bank["filters"]], PAIRS)
        for name in PAIRS:
            self.assertIn(name, answer.out)

    def test_writes_where_it_is_told_and_the_same_each_time(self):
        self.run_ok("design", "bank.toml", "-o", "a.bank.json")
        self.run_ok("design", "bank.toml", "--output", "b.bank.json")
        self.assertEqual(self.folder.read("a.bank.json"), self.folder.read("b.bank.json"))
        self.assertFalse(os.path.exists(self.folder.file("bank.bank.json")))

    def test_result_as_data(self):
        answer = self.run_ok("design", "bank.toml", "--json", "-")
        design = json.loads(answer.out)
        self.assertIs(design["solvable"], True)
        self.assertEqual(design["failing"], [])
        self.assertEqual([residual["name"] for residual in design["residuals"]], PAIRS)
        for residual in design["residuals"]:
            self.assertLessEqual(self.KEYS, set(residual))
            ignored = residual["decouples"]
            self.assertEqual(residual["name"], "r" + "".join(fault[1] for fault in ignored))
            self.assertIs(residual["exists"], True)
            self.assertEqual(residual["responds_to"], [fault for fault in FAULTS if fault not in ignored])
            self.assertEqual(residual["transient_only"], [])
            self.assertEqual((residual["dim_w"], residual["dim_s"], residual["quotient_dim"], residual["rows"]),
                             (2, 2, 1, 1))
            for key in ("projector_w", "projector_s"):
                self.assertEqual([len(row) for row in residual[key]], [3, 3, 3])
                self.assertAlmostEqual(sum(residual[key][i][i] for i in range(3)), 2.0)  # trace of Π: its rank
            for fault in FAULTS:
                bound = self.assertLess if fault in ignored else self.assertGreater
                bound(residual["margins"][fault], 1e-9)
                bound(residual["dc_gain"][fault], 1e-9)
            # Normalised: the smallest gain it must see is one.
            self.assertAlmostEqual(min(residual["dc_gain"][fault] for fault in residual["responds_to"]), 1.0)
            ((real, imaginary),) = residual["poles"]
            self.assertAlmostEqual(real, 0.9048374180359595)  # exp(-10 · 0.01)
            self.assertEqual(imaginary, 0.0)
            self.assertLess(residual["certificate"]["spectral_radius"], 1.0)
            # Recomputed by other code from the filter as it runs, and yet the same.
            for key, design_key in (("dc_gain", "dc_gain"), ("margin", "margins")):
                for fault, value in zip(FAULTS, residual["certificate"][key]):
                    self.assertAlmostEqual(value, residual[design_key][fault])
            self.assertEqual(residual["certificate"]["rank"]["dim_s"], residual["dim_s"])

    def test_result_as_data_in_a_file(self):
        answer = self.run_ok("design", "bank.toml", "--json", "design.json")
        self.assertIs(json.loads(self.folder.read("design.json"))["solvable"], True)
        self.assertIn("r12", answer.out)

    def test_a_plant_without_solution_is_a_negative_answer_that_says_which_sets(self):
        self.folder.patch("plant.toml", *UNSOLVABLE)
        answer = self.folder.run("design", "bank.toml", "--json", "design.json")
        self.assert_code(1, answer)
        self.assertIn("NOT SOLVABLE", answer.out)
        self.assertIn("u1, u2", answer.out)
        design = json.loads(self.folder.read("design.json"))
        self.assertIs(design["solvable"], False)
        self.assertIn(["u1", "u2", "u3"], design["failing"])
        for failure in design["failing_reasons"]:
            self.assertIn("rank C W* = rank C = 2", failure["reason"])
            self.assertIn(failure["reason"], answer.out)
        missing = [residual for residual in design["residuals"] if not residual["exists"]]
        self.assertTrue(missing)
        for residual in missing:
            self.assertTrue(residual["reason"])
        self.assertFalse(os.path.exists(self.folder.file("bank.bank.json")))

    def test_an_unwritable_bank_file_is_a_failure(self):
        for output in ("nosuch/b.bank.json", ".", "/proc/b.bank.json"):
            with self.subTest(output=output):
                answer = self.folder.run("design", "bank.toml", "-o", output)
                self.assert_code(3, answer)
                self.assertIn(output, answer.err)

    def test_unwritable_data_is_a_failure(self):
        for target in ("nosuch/design.json", "/dev/full"):
            answer = self.folder.run("design", "bank.toml", "--json", target)
            self.assert_code(3, answer)
            self.assertIn(target, answer.err)

    def test_the_residuals_that_exist_can_be_had_and_run(self):
        self.folder.patch("plant.toml", *OFFSET)
        self.folder.patch("bank.toml", ("concurrent    = 2", "concurrent = 1\ndecouple = [\"offset\"]"),
                          ("[-10.0]", "[-10.0, -11.0]"))
        answer = self.folder.run("design", "bank.toml")
        self.assert_code(1, answer)
        self.assertIn("ignoring {u1} hides u3: the decoupled disturbance takes the outputs it needs", answer.out)
        self.assertIn("--partial", answer.out)
        self.assertFalse(os.path.exists(self.folder.file("bank.bank.json")))
        answer = self.folder.run("design", "bank.toml", "--partial", "--json", "design.json")
        self.assert_code(1, answer)
        design = json.loads(self.folder.read("design.json"))
        self.assertEqual(design["indistinguishable"], [[["u1"], ["u3"]]])
        self.assertEqual([residual["transient_only"] for residual in design["residuals"]], [[], ["u4"], [], ["u2"]])
        self.folder.patch("demo.toml", ('"bank.toml"', '"bank.bank.json"'))
        run = self.folder.run("run", "demo.toml", "--json", "-")  # u2 and u3 are more than one fault
        self.assert_code(1, run)

    def test_a_constant_offset_costs_no_residual_but_some_see_faults_in_transients_only(self):
        self.folder.patch("plant.toml", *OFFSET)
        self.folder.patch("bank.toml", ("normalise", "decouple_constant = [\"offset\"]\nnormalise"),
                          ("poles         = [-10.0]", "decay_rate_per_s = 5.0"))
        design = json.loads(self.run_ok("design", "bank.toml", "--json", "-").out)
        steady = [residual["name"] for residual in design["residuals"] if not residual["transient_only"]]
        self.assertEqual(steady, ["r13", "r24"])
        for residual in design["residuals"]:
            self.assertEqual(len(residual["projector_s"]), 4)  # three states and the offset
            for real, _ in residual["design_poles"]:
                self.assertLessEqual(real, -5.0)

    def test_says_which_faults_can_look_alike(self):
        answer = self.run_ok("design", "bank.toml", "--json", "design.json")
        self.assertIn("(u1, u2) = (2, 1)·g looks like (u3, u4) = (1, 1)·g", answer.out)
        design = json.loads(self.folder.read("design.json"))
        self.assertIs(design["signatures_distinct"], True)
        self.assertIs(design["strongly_isolable"], False)
        self.assertEqual(design["confusable_sets"], [FAULTS])
        self.assertEqual([[round(2 * weight, 9) for weight in design["confusable_weights"][0]]], [[2, 1, -1, -1]])

    def test_says_how_small_a_fault_it_finds_and_how_soon(self):
        design = json.loads(self.run_ok("design", "bank.toml", "--json", "-").out)
        u1 = design["faults"]["u1"]
        # Normalised: half a fault of size one; a step of one crosses after ln 2 / 10 s, then dwell and settle.
        self.assertAlmostEqual(u1["detected_from"], 0.5, places=9)
        self.assertAlmostEqual(u1["isolated_from"], 0.5, places=9)
        self.assertTrue(0.069 + 0.04 <= u1["isolation_delay_s"] <= 0.069 + 0.06, u1)

    def test_says_what_rounding_on_the_bus_does(self):
        answer = self.run_ok("design", "bank.toml", "--dbc", "bench.dbc", "--json", "design.json")
        self.assertIn("rounding on the bus", answer.out)
        self.assertNotIn("WARNING", answer.out)
        fine = json.loads(self.folder.read("design.json"))["quantisation"]
        self.folder.write("bench.dbc", self.folder.read("bench.dbc").replace(b"(0.0001,0)", b"(0.01,0)"))
        answer = self.run_ok("design", "bank.toml", "--dbc", "bench.dbc", "--json", "design.json")
        self.assertIn("WARNING", answer.out)
        coarse = json.loads(self.folder.read("design.json"))["quantisation"]
        for one, other in zip(fine, coarse):
            self.assertAlmostEqual(other["error"] / one["error"], 100.0, places=6)
            self.assertIs(one["warning"], False)
        self.assertIn(True, [residual["warning"] for residual in coarse])
        # Each signal's share is at least what a constant half LSB does.
        for name in ("y1", "y2", "y3", "u1"):
            self.assertIn(name, fine[0]["signals"])

    def test_structure_as_sets_and_as_the_smallest(self):
        self.folder.patch("bank.toml", ("normalise", "structure = [[\"u1\", \"u2\"], [\"u4\"]]\nnormalise"),
                          ("[-10.0]", "[-10.0, -12.0]"))
        design = json.loads(self.run_ok("design", "bank.toml", "--json", "-").out)
        self.assertEqual([residual["name"] for residual in design["residuals"]], ["r12", "r4"])
        self.assertIs(design["signatures_distinct"], False)
        self.folder.patch("bank.toml", ("[[\"u1\", \"u2\"], [\"u4\"]]", "\"smallest\""), ("concurrent    = 2", "concurrent = 1"))
        answer = self.run_ok("design", "bank.toml")
        self.assertRegex(answer.out, r"\d+ of 10 residuals are enough; fewer are not")

    def test_bad_requests_are_refused_where_they_stand(self):
        for old, new, words in (
                ("[-10.0]", "[§10.0]", ["poles", "found 10", "negative real parts"]),
                ("[-10.0]", "§[[-3, 4]]", ["alone, expected its conjugate"]),
                ("poles         = [-10.0]", "decay_rate_per_s = §-1.0", ["decay_rate_per_s", "expected a positive"]),
                ("normalise", "structure = §[[\"u1\", \"u9\"]]\nnormalise", ["structure", "u9", "names of the plant's faults"]),
                ("normalise", "decouple_constant = §[\"d\"]\nnormalise", ["decouple_constant", "found \"d\""]),
                ("concurrent    = 2", "concurrent = §4", ["concurrent", "found 4", "less than the plant's 4 faults"])):
            with self.subTest(new=new):
                before = self.folder.read("bank.toml")
                place = self.folder.patch("bank.toml", (old, new))
                answer = self.folder.run("design", "bank.toml")
                self.assert_code(2, answer)
                self.assertIn("bank.toml:" + place.split(":")[0] + ":", answer.err)
                for word in words:
                    self.assertIn(word, answer.err)
                self.folder.write("bank.toml", before)

    def test_plants_that_cannot_be_used_are_refused_or_not_solvable(self):
        b = "B = [[1, 0, 1, 1],\n     [0, 1, 1, 0],\n     [0, 1, 0, 1]]"
        for change, code, words in (
                (("A = [[1, 1, 1]", "A = [[nan, 1, 1]"), 2, ["plant.toml", "nan"]),
                (("A = [[1, 1, 1]", "A = [[1e400, 1, 1]"), 2, ["plant.toml"]),
                ((b, b.replace("[0, 1, 1, 0]", "[0, 1, 0, 0]").replace("1, 0, 1, 1", "1, 0, 1, 2")), 1,
                 ["depends on", "Corollary 1"]),
                (("     [1, 0, 2]]", "     [0, 0, 0]]"), 1, ["rank C W* = rank C = 2"]),
                (("C = [[0, 1, 0]", "C = [[0, 1e-12, 0]"), 0, ["solvable"]),
                (("C = [[0, 1, 0]", "C = [[0, 1e12, 0]"), 0, ["solvable"])):
            with self.subTest(change=change[1]):
                before = self.folder.read("plant.toml")
                self.folder.patch("plant.toml", change)
                answer = self.folder.run("design", "bank.toml")
                self.assert_code(code, answer)
                for word in words:
                    self.assertIn(word, answer.out + answer.err)
                self.folder.write("plant.toml", before)


if __name__ == "__main__":
    unittest.main()
