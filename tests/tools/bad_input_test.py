#!/usr/bin/python3
"""Every file a run is made from, wrong in each way."""
import os
import random
import unittest

from faultline_program import OLD_LOG, FolderTest, without_comments


class BadInput(FolderTest):
    """Each file wrong in each way: exit 2, FILE:LINE:COLUMN, what was found and what was expected; no log touched."""

    def setUp(self):
        super().setUp()
        self.folder.write("s.toml", without_comments(self.folder.read("demo.toml").decode()))
        self.folder.write("old.lcm", OLD_LOG)

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
            self.assertEqual(self.folder.read("old.lcm"), OLD_LOG)
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


if __name__ == "__main__":
    unittest.main()
