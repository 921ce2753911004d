#!/usr/bin/python3
"""What a scenario's [controller] and [simulation] may not say: exit code 2, the key, what was expected."""
import os
import unittest

from faultline_program import FolderTest

HEAD = """schema = 1
name   = "s"
plant  = "plant.toml"
bank   = "bank.toml"
dbc    = "bench.dbc"
duration_s = 1.0
"""
PLAIN = '[controller]\nkind = "lqr"\n'
ROW = "[1, 0, 0], [0, 1, 0], [0, 0, 1]"


class ScenarioInput(FolderTest):
    def assert_refused(self, text, *expected):
        self.folder.write("s.toml", HEAD + text)
        before = sorted(os.listdir(self.folder.path))
        answer = self.folder.run("run", "s.toml", "--no-log")
        self.assertEqual(answer.code, 2, (text, answer))
        self.assertRegex(answer.err, r"s\.toml:\d+(:\d+)?: ", text)
        for part in expected:
            self.assertIn(part, answer.err, text)
        self.assertEqual(sorted(os.listdir(self.folder.path)), before)

    def test_what_the_cases_differ_from_is_accepted(self):
        for text in (PLAIN, PLAIN + '[simulation]\nmethod = "exact"\n'):
            self.folder.write("s.toml", HEAD + text)
            self.assertEqual(self.folder.run("run", "s.toml", "--no-log").code, 0)

    def test_controller(self):
        for text, *expected in (
                ('kind = "lqt"', "kind", '"lqr"'),
                ("kind = 3", "kind", "expected"),
                ("feedforward = [1, 1, 1, 1]", "kind"),
                ('kind = "lqr"\nfeedforward = [1.0]', "feedforward", "expected"),
                ('kind = "lqr"\nfeedforward = [nan, 0, 0, 0]', "feedforward", "expected"),
                ('kind = "lqr"\nQ = [[1, 2], [3]]', "Q", "expected"),
                ('kind = "lqr"\nR = [[0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]', "controller", "found R not positive definite"),
                ('kind = "lqr"\nK = [[1]]', 'found unknown key "K"'),
                ('kind = "gain"', "K", "expected"),
                ('kind = "gain"\nK = [[1, 2]]', "K", "expected"),
                (f'kind = "observer"\nK = [{ROW}, [0, 0, 0]]\nQ = [{ROW}]', "K", "Q"),
                ('kind = "observer"\nL = [[1]]', "L", "expected"),
                ('kind = "pid"', "loop", "expected"),
                ('kind = "pid"\n[[controller.loop]]\noutput = "y9"\ninput = "u1"\nK_p = 1', "output", "y9", "expected"),
                ('kind = "pid"\n[[controller.loop]]\noutput = "y1"\ninput = "u1"\nK_p = 1\nT_i_s = 0', "T_i_s", "expected"),
                ('kind = "pid"\n[[controller.loop]]\noutput = "y1"\ninput = "u1"\nK_p = 1\nT_i_s = 1\nanti_windup = "none"',
                 "anti_windup", "back_calculation"),
                ('kind = "recorded"', "file", "expected"),
                ('kind = "lqr"\nlimits = { u1 = [2, -2] }', "limits", "u1", "expected"),
                ('kind = "lqr"\nlimits = { u9 = [-2, 2] }', "u9", "expected"),
                ('kind = "lqr"\nreference = { y9 = 1 }', "reference", "y9", "expected")):
            with self.subTest(text):
                self.assert_refused(f"[controller]\n{text}\n", *expected)

    def test_simulation(self):
        for text, *expected in (
                ('method = "rk5"', "method", '"rk4"'),
                ('method = ""', "method", '"rk4"'),
                ('method = "exact"\nsubsteps = 4', "substeps", '"rk4" only'),
                ('method = "rk4"\nsubsteps = 0', "substeps", "found 0, expected 1 to"),
                ('method = "rk4"\nsubsteps = -1', "substeps", "found -1, expected 1 to"),
                ('method = "rk4"\nsubsteps = 1.5', "substeps", "expected"),
                ('method = "rk4"\nabsolute_tolerance = 1e-6', "absolute_tolerance", '"dormand_prince" only'),
                ('method = "dormand_prince"\nabsolute_tolerance = 0', "absolute_tolerance", "expected a positive number"),
                ('method = "dormand_prince"\nrelative_tolerance = -1', "relative_tolerance", "expected a positive number"),
                ('method = "dormand_prince"\nrelative_tolerance = nan', "relative_tolerance", "expected"),
                ('model = ""', "model", "expected the name of a plant"),
                ('model = "hou2016"', "model", '"hou2015"'),
                ('model = "three_tank"', "three_tank", "expected"),
                ('model = "hou2015"\nlibrary = "a.so"', "library", "found it beside `model`"),
                ('library = ""', "library", "expected a file"),
                ('library = "none.so"', "none.so", "found no file, expected a shared library"),
                ('method = "exact"\nparameters = { a = 1 }', "parameters", "found it without `model` or `library`"),
                ('model = "hou2015"\nparameters = { a = 1 }', "parameters", '"a"', "expected"),
                ('model = "hou2015"\nparameters = 3', "parameters", "expected"),
                ('method = "rk4"\nstep_s = 0.1', 'found unknown key "step_s"')):
            with self.subTest(text):
                self.assert_refused(f"{PLAIN}[simulation]\n{text}\n", *expected)

    def test_an_external_controller_is_not_on_the_loop_bus(self):
        self.folder.write("s.toml", HEAD + '[controller]\nkind = "external"\n')
        answer = self.folder.run("run", "s.toml", "--no-log")
        self.assertEqual(answer.code, 2, answer)
        self.assertIn('bus: found "loop", expected a bus that it is on', answer.err)


if __name__ == "__main__":
    unittest.main()
