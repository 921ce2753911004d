#!/usr/bin/python3
"""`faultline info` of every kind of file."""
import json
import os
import unittest

from faultline_program import FolderTest

FAULTS = ["u1", "u2", "u3", "u4"]
PAIRS = ["r12", "r13", "r14", "r23", "r24", "r34"]


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


if __name__ == "__main__":
    unittest.main()
