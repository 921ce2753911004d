#!/usr/bin/python3
"""Runs that end before their time: signals and kills; the log stays readable."""
import json
import os
import shutil
import signal
import time
import unittest

from faultline_program import EXAMPLE, FolderTest, decode_all, finish, program, read_log, reassemble_parts, wait_for

STOP_WITHIN_S = 2.0
LONG_S = "1e5"  # at 100 Hz: minutes in lock-step


class Interruption(FolderTest):
    def start_long_run(self, *arguments):
        self.folder.patch("demo.toml", ("duration_s = 10.0", f"duration_s = {LONG_S}"))
        process = self.folder.start("run", "demo.toml", "--log", "own.lcm", *arguments)
        self.addCleanup(lambda: process.poll() is None and process.kill())
        wait_for(lambda: os.path.exists(self.folder.file("own.lcm"))
                 and os.path.getsize(self.folder.file("own.lcm")) > 50_000)
        return process

    def test_a_signal_stops_the_run_cleanly(self):
        for number, arguments in ((signal.SIGINT, []), (signal.SIGTERM, []),
                                  (signal.SIGINT, ["--realtime"]), (signal.SIGTERM, ["--realtime"])):
            with self.subTest(signal=number, arguments=arguments):
                shutil.copy(f"{EXAMPLE}/demo.toml", self.folder.path)
                self.folder.write("own.lcm", b"")
                process = self.start_long_run("--json", "run.json", *arguments)
                begin = time.monotonic()
                process.send_signal(number)
                answer = finish(process)
                self.assertLess(time.monotonic() - begin, STOP_WITHIN_S)
                self.assert_code(128 + number, answer)
                self.assertIn("demo on loop", answer.out)
                self.assertIn(f"STOPPED by signal {int(number)}", answer.out)
                self.assertIs(json.loads(self.folder.read("run.json"))["interrupted"], True)
                events, rest = read_log(self.folder.file("own.lcm"))
                self.assertEqual((events[-1].channel, rest), ("FAULTLINE_STATS", 0))
                self.assertEqual([event.number for event in events], list(range(len(events))))
                messages = decode_all(events)
                for channel, found in messages.items():
                    self.assertEqual([message["sequence"] for message in found], list(range(len(found))), channel)
                cycles = [sample["cycle"] for sample in messages["FAULTLINE_SAMPLE"]]
                self.assertEqual(cycles, list(range(len(cycles))))
                self.assertEqual(messages["FAULTLINE_STATS"][-1]["samples"], len(cycles))
                self.assertIn("signal", messages["FAULTLINE_EVENT"][-1]["text"])

    def test_a_second_signal_does_no_harm(self):
        process = self.start_long_run()
        for _ in range(3):
            process.send_signal(signal.SIGINT)
        self.assertIn(finish(process).code, (130, -signal.SIGINT))
        events, rest = read_log(self.folder.file("own.lcm"))
        self.assertEqual((events[-1].channel, rest), ("FAULTLINE_STATS", 0))

    def assert_readable(self, name):
        events, _ = read_log(self.folder.file(name))
        messages = decode_all(events)
        self.assertGreater(len(messages["FAULTLINE_SAMPLE"]), 10)
        for channel, found in messages.items():
            self.assertEqual([message["sequence"] for message in found], list(range(len(found))), channel)
        self.assertEqual(reassemble_parts(messages["FAULTLINE_RUN"])["scenario"], self.folder.read("demo.toml"))
        data = json.loads(self.run_ok("info", name, "--json", "-").out)
        self.assertEqual(data["messages"], len(events))
        self.assertEqual(data["undecodable"], 0)
        return messages

    def test_a_killed_run_in_lock_step_leaves_a_readable_log(self):
        process = self.start_long_run()
        process.kill()
        self.assertEqual(finish(process).code, -signal.SIGKILL)
        self.assert_readable("own.lcm")

    def test_a_killed_run_in_real_time_loses_a_tenth_of_a_second(self):
        # Three tries: the bound is the program's, not the scheduler's of a busy machine.
        losses_s = []
        for _ in range(3):
            shutil.copy(f"{EXAMPLE}/demo.toml", self.folder.path)
            self.folder.write("own.lcm", b"")
            process = self.start_long_run("--realtime")
            time.sleep(0.3)
            killed_s = time.time()
            process.kill()
            self.assertEqual(finish(process).code, -signal.SIGKILL)
            messages = self.assert_readable("own.lcm")
            losses_s.append(killed_s - messages["FAULTLINE_SAMPLE"][-1]["utime"] * 1e-6)
            if losses_s[-1] <= 0.1:
                break
        self.assertLessEqual(min(losses_s), 0.1)


if __name__ == "__main__":
    unittest.main()
