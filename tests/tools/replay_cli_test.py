#!/usr/bin/python3
"""`faultline replay` as a user meets it."""
import json
import os
import random
import signal
import unittest

from faultline_program import FolderTest, finish, read_log


class Replay(FolderTest):
    def setUp(self):
        super().setUp()
        self.run_ok("run", "demo.toml", "--log", "demo.lcm", "-q")

    def replay(self, *arguments, code=0):
        answer = self.folder.run("replay", *arguments, "--json", "-")
        self.assert_code(code, answer)
        return json.loads(answer.out)

    def verdicts(self, answer):
        return [(entry["verdict"], entry["faults"]) for entry in answer["verdicts"]]

    def test_a_run_is_reproduced_to_the_bit(self):
        answer = self.run_ok("replay", "demo.lcm", "--verify")
        self.assertIn("VERIFIED: reproduced to the bit", answer.out)
        self.assertIn("isolated u2, u3", answer.out)
        run, = self.replay("demo.lcm", "--verify")["runs"]
        self.assertEqual(run["scenario"], "demo")
        self.assertTrue(run["ended"])
        self.assertTrue(run["verification"]["verified"])
        self.assertIsNone(run["verification"]["first_difference"])
        samples = run["verification"]["channels"]["FAULTLINE_SAMPLE"]
        self.assertEqual((samples["recorded"], samples["identical"]), (1001, 1001))
        self.assertEqual(self.verdicts(run["answers"][0]),
                         [("inhibited", []), ("healthy", []), ("isolated", ["u2", "u3"])])

    def test_a_run_in_real_time_is_reproduced_to_the_bit(self):
        self.folder.patch("demo.toml", ("duration_s = 10.0", "duration_s = 5.0"), ("until_s = 10.0", "until_s = 5.0"))
        self.folder.run("run", "demo.toml", "--realtime", "--log", "rt.lcm", "-q")
        run, = self.replay("rt.lcm", "--verify")["runs"]
        self.assertEqual(run["verification"]["channels"]["FAULTLINE_RESIDUAL"]["identical"], 501)

    def test_a_changed_residual_fails_and_is_shown(self):
        events, _ = read_log(self.folder.file("demo.lcm"))
        victim = [event for event in events if event.channel == "FAULTLINE_RESIDUAL"][700]
        log = bytearray(self.folder.read("demo.lcm"))
        at = log.find(victim.data)
        self.assertEqual(log.count(victim.data), 1)
        log[at + 8 * 4 + 4 + 7] ^= 1  # the last bit of the first residual
        self.folder.write("changed.lcm", bytes(log))
        answer = self.folder.run("replay", "changed.lcm", "--verify")
        self.assert_code(1, answer)
        self.assertIn("first difference\n  FAULTLINE_RESIDUAL, cycle 700\n    residual r12: recorded ", answer.out)
        # Without --verify the question is what the diagnosis says, and that is as expected.
        self.assertIn("DIFFERENT", self.run_ok("replay", "changed.lcm").out)

    def test_another_bank_stands_beside_the_recorded_one(self):
        self.folder.patch("bank.toml", ("threshold = 0.5", "threshold = 50.0"))
        answer = self.folder.run("replay", "demo.lcm", "--bank", "bank.toml")
        self.assert_code(1, answer)  # its expectations are not met
        self.assertRegex(answer.out, r"4\.070   isolated u2, u3 +healthy\n")
        run, = self.replay("demo.lcm", "--bank", "bank.toml", "--verify")["runs"]
        self.assertEqual([found["expect"]["met"] for found in run["answers"]], [True, False])
        self.assertTrue(run["verification"]["verified"])

    def test_candump_logs_are_read_with_a_bank_and_a_dbc(self):
        self.run_ok("can", "convert", "demo.lcm", "demo.log")
        self.run_ok("design", "bank.toml", "-o", "my.bank.json")
        expected, = self.replay("demo.lcm")["runs"]
        for how in (["--bank", "my.bank.json", "--dbc", "bench.dbc"], ["--scenario", "demo.toml"]):
            run, = self.replay("demo.log", *how)["runs"]
            self.assertEqual(run["frames"], expected["frames"])
            self.assertEqual(run["answers"][0]["verdicts"], expected["answers"][0]["verdicts"])
            self.assertIsNone(run["verification"])
            answer = self.folder.run("replay", "demo.log", *how, "--verify")
            self.assert_code(1, answer)
            self.assertIn("NOT VERIFIED: there are no recorded results", answer.out)

    def test_bad_input_is_told(self):
        self.folder.write("text.lcm", "no log, no frames\n" * 200)
        self.folder.write("empty.lcm", "")
        self.run_ok("can", "convert", "demo.lcm", "frames.log")
        self.run_ok("can", "convert", "frames.log", "frames.lcm")
        for arguments, expected in (
                (["none.lcm"], "none.lcm"),
                ([self.folder.path], "directory"),
                (["text.lcm"], "no bank in it"),
                (["empty.lcm"], "empty.lcm"),
                (["frames.lcm"], "found no bank in it, expected one with --scenario FILE, or with --bank FILE"),
                (["demo.lcm", "--bank", "none.json"], "none.json"),
                (["demo.lcm", "--bank", "plant.toml"], "plant.toml:"),
                (["demo.lcm", "--dbc", "bench.dbc"], "--bank"),
                (["demo.lcm", "--log", "./demo.lcm"], "demo.lcm: found the log to replay, expected another file"),
                (["demo.lcm", "--log", "bench.dbc"], "bench.dbc: found a file that is no LCM log"),
                ([], "LOG")):
            answer = self.folder.run("replay", *arguments)
            self.assert_code(2, answer)
            self.assertIn(expected, answer.err + answer.out)
        self.assertTrue(self.folder.read("bench.dbc").startswith(b"VERSION"))
        self.run_ok("replay", "demo.lcm", "--verify")

    def test_damaged_logs_are_read_to_their_end(self):
        log = self.folder.read("demo.lcm")
        draw = random.Random(5)
        for _ in range(60):
            damaged = bytearray(log)
            for _ in range(draw.randint(1, 20)):
                at = draw.randrange(len(damaged))
                kind = draw.randrange(4)
                if kind == 0:
                    damaged[at] ^= 1 << draw.randrange(8)
                elif kind == 1:
                    del damaged[at:at + draw.randrange(2000)]
                elif kind == 2:
                    damaged[at:at] = draw.randbytes(draw.randrange(2000))
                else:
                    damaged[at:at + 4] = draw.randbytes(4)
            self.folder.write("damaged.lcm", bytes(damaged))
            answer = self.folder.run("replay", "damaged.lcm", "--verify", "--json", "out.json")
            self.assertIn(answer.code, (0, 1, 2), answer.err[-1000:])
            if answer.code == 2:  # parts of the run, or a schema, are damaged
                self.assertRegex(answer.err, "found|expected")

    def test_killed_replays_leave_no_process_and_a_log_that_can_be_read(self):
        self.folder.patch("demo.toml", ("duration_s = 10.0", "duration_s = 2000.0"))
        self.folder.run("run", "demo.toml", "--log", "long.lcm", "-q")
        process = self.folder.start("replay", "long.lcm", "--log", "out.lcm")
        while process.poll() is None and not (os.path.exists(self.folder.file("out.lcm"))
                                              and os.path.getsize(self.folder.file("out.lcm")) > 100000):
            pass
        process.send_signal(signal.SIGKILL)
        finish(process)
        run, = self.replay("out.lcm", "--verify")["runs"]
        self.assertFalse(run["ended"])
        self.assertGreater(run["verification"]["channels"]["FAULTLINE_RESIDUAL"]["identical"], 100)


if __name__ == "__main__":
    unittest.main()
