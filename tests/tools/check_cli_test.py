#!/usr/bin/python3
"""`faultline check`: banks that hold, tampered ones, those of another plant."""
import json
import unittest

from faultline_program import FolderTest

PAIRS = ["r12", "r13", "r14", "r23", "r24", "r34"]


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


if __name__ == "__main__":
    unittest.main()
