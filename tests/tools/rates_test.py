#!/usr/bin/python3
"""[rates] of a scenario: sensor messages that are slower than the cycle."""
import csv
import re
import unittest

from faultline_program import ROOT, FolderTest

SCENARIO = """schema = 1
name   = "slow"
plant  = "plant.toml"
bank   = "bank.toml"
dbc    = "bench.dbc"
duration_s = 5.0

[controller]
kind = "lqr"
feedforward = [1.0, 1.0, 1.0, 1.0]

[rates]
Sensors2 = 4

[[expect]]
from_s  = 2.0
until_s = 5.0
verdict = "healthy"
"""


class Rates(FolderTest):
    def setUp(self):
        super().setUp()
        self.folder.write("slow.toml", SCENARIO)

    def run_slow(self, *arguments):
        answer = self.folder.run("run", "slow.toml", "--log", "run.lcm", *arguments)
        self.assertEqual(answer.code, 0, answer)
        return answer

    def table(self, name):
        answer = self.folder.run("log", "export", "run.lcm", "-o", "tables")
        self.assertEqual(answer.code, 0, answer)
        with open(self.folder.file(f"tables/{name}.csv"), encoding="utf-8") as file:
            return list(csv.DictReader(file))

    def test_a_slow_message_is_sent_in_its_cycles_and_held_in_good_samples(self):
        answer = self.run_slow()
        samples = int(re.search(r"samples  (\d+), bad 0\n", answer.out).group(1))
        self.assertRegex(answer.out, rf"cycles   {samples}, late 0,")
        frames = [int(row["id"]) for row in self.table("can")]
        self.assertEqual(frames.count(272), samples)
        self.assertEqual(frames.count(273), (samples + 3) // 4)
        self.assertEqual(frames.count(288), samples, "the controller answers in each")
        values = [row["y3"] for row in self.table("sample")]
        for k, value in enumerate(values):
            self.assertEqual(value, values[k - k % 4], k)
        self.assertGreater(len(set(values)), 1)

    def test_a_fault_is_found_and_a_replay_agrees_to_the_bit(self):
        self.folder.write("slow.toml", SCENARIO + """
[[fault]]
target = "u2"
kind   = "bias"
at_s   = 3.0
value  = 2.0
""".replace("healthy", "unexplained"))
        self.folder.patch("slow.toml", ("until_s = 5.0", "until_s = 2.99"))
        self.run_slow()
        answer = self.folder.run("replay", "run.lcm", "--verify")
        self.assertEqual(answer.code, 0, answer)
        answer = self.folder.run("log", "info", "run.lcm")
        self.assertEqual(answer.code, 0, answer)
        answer = self.folder.run("replay", "run.lcm", "--bank", "bank.toml")
        self.assertEqual(answer.code, 0, answer)
        self.assertNotIn("missing", answer.out)

    def test_a_lost_frame_of_a_slow_message_is_blamed_on_it(self):
        self.folder.write("slow.toml", SCENARIO + """
[[fault]]
target = "Sensors2"
kind   = "dropped"
at_s   = 0.1
until_s = 0.5
""")
        answer = self.run_slow()
        self.assertRegex(answer.out, r"samples  \d+, bad [1-9]")
        self.assertIn("inhibited (Sensors2: missing)", answer.out)

    def test_info_tells_it(self):
        answer = self.folder.run("info", "slow.toml")
        self.assertEqual(answer.code, 0, answer)
        self.assertIn("message Sensors2 every 4 cycles", answer.out)

    def test_an_example_has_it(self):
        answer = self.folder.run("run", f"{ROOT}/examples/three_tank/slow_levels.toml", "--no-log")
        self.assertEqual(answer.code, 0, answer)
        self.assertIn("bad 0", answer.out)

    def test_refuses_what_cannot_be(self):
        for line, text in (
                ("Sensors2 = §0", "found 0, expected 1 to 100 cycles per frame"),
                ("Sensors2 = §-4", "found -4, expected 1 to 100"),
                ("Sensors2 = §101", "found 101, expected 1 to 100"),
                ("Sensors2 = §2.5", "expected"),
                ("Sensors2 = §\"4\"", "expected"),
                ("Sensor2 = §4", 'rates: found "Sensor2", expected a message that carries outputs (Sensors1, Sensors2); '
                                 'did you mean "Sensors2"?'),
                ("Sync = §4", "not SYNC: it begins each cycle"),
                ("Commands1 = §4", "not one with commands: each cycle has its own"),
                ("Sensors1 = §2\nSensors2 = 4", "found every message with outputs slower than the cycle")):
            with self.subTest(line):
                self.folder.write("slow.toml", SCENARIO)
                place = self.folder.patch("slow.toml", ("Sensors2 = 4", line))
                answer = self.folder.run("run", "slow.toml", "--no-log")
                self.assertEqual(answer.code, 2, answer)
                self.assertIn(text, answer.err)
                self.assertRegex(answer.err, rf"slow\.toml:{place.split(':')[0]}:")


if __name__ == "__main__":
    unittest.main()
