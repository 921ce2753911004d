#!/usr/bin/python3
"""What `faultline run --lcm` publishes, recorded by lcm-logger, equals the run's own log.

The whole takes place in a network namespace of its own, where nobody else's LCM traffic is.
"""
import collections
import json
import os
import signal
import subprocess
import unittest

from faultline_program import FolderTest, decode_all, finish, read_log, reassemble_parts, wait_for
from multicast_namespace import URL, enter_namespace, send_probe

PARTS = {"scenario": "short.toml", "plant": "plant.toml", "bank_request": "bank.toml", "dbc": "bench.dbc"}


class LcmLogger(FolderTest):
    def setUp(self):
        super().setUp()
        text = self.folder.read("demo.toml").decode()
        text = text[:text.index("[[expect]]")].replace("duration_s = 10.0", "duration_s = 2.0")
        self.folder.write("short.toml", text.replace("at_s   = 4.0", "at_s   = 1.0"))

    def start_logger(self):
        logger = subprocess.Popen(["lcm-logger", "--quiet", "--flush-interval=20", "--lcm-url", URL, "recorded.lcm"],
                                  cwd=self.folder.path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        self.addCleanup(lambda: logger.poll() is None and (logger.kill(), logger.communicate()))
        # LCM joins the group before it knows what it has subscribed to: only a message that got through
        # shows that the logger listens.
        log = self.folder.file("recorded.lcm")

        def has_heard_a_probe():
            send_probe()
            return os.path.exists(log) and os.path.getsize(log) > 0

        wait_for(has_heard_a_probe)
        return logger

    @staticmethod
    def payloads(events):
        by_channel = collections.defaultdict(list)
        for event in events:
            by_channel[event.channel].append(event.data)
        return by_channel

    def record(self):
        """Returns the events of a run's own log and those that lcm-logger recorded meanwhile."""
        logger = self.start_logger()
        self.run_ok("run", "short.toml", "--realtime", "--lcm", URL, "--log", "own.lcm")
        own, rest = read_log(self.folder.file("own.lcm"))
        self.assertEqual(rest, 0)

        def has_the_last():  # lcm-logger writes behind a queue
            recorded = read_log(self.folder.file("recorded.lcm"))[0]
            return recorded and recorded[-1].data == own[-1].data

        wait_for(has_the_last)
        logger.send_signal(signal.SIGINT)
        answer = finish(logger)
        self.assertEqual(answer.code, 0, answer.out)
        recorded, rest = read_log(self.folder.file("recorded.lcm"))
        self.assertEqual(rest, 0)
        # liblcm probes multicast by a message of its own when the bench begins to listen for INJECT.
        return own, [event for event in recorded if event.channel not in ("PROBE", "LCM_SELF_TEST")]

    def assert_equal_messages(self, own, recorded):
        expected, found = self.payloads(own), self.payloads(recorded)
        self.assertLessEqual({"FAULTLINE_DIAGNOSIS", "FAULTLINE_RESIDUAL", "FAULTLINE_SAMPLE", "FAULTLINE_CAN",
                              "FAULTLINE_RUN", "FAULTLINE_TRUTH", "FAULTLINE_EVENT", "FAULTLINE_STATS"}, set(expected))
        self.assertEqual(set(found), set(expected))
        for channel in expected:
            self.assertEqual(len(found[channel]), len(expected[channel]), channel)
            self.assertTrue(found[channel] == expected[channel], f"{channel}: a message differs")

    def test_a_recorded_run_equals_its_own_log(self):
        own, recorded = self.record()
        self.assert_equal_messages(own, recorded)
        messages = decode_all(recorded)
        self.assertEqual([sample["cycle"] for sample in messages["FAULTLINE_SAMPLE"]], list(range(201)))
        verdicts = [(message["verdict"], [found["faults"] for found in message["sets"]])
                    for message in messages["FAULTLINE_DIAGNOSIS"]]
        self.assertEqual(verdicts[0], ("inhibited", []))
        self.assertGreaterEqual(len(verdicts), 3)
        parts = reassemble_parts(messages["FAULTLINE_RUN"])
        for part, name in PARTS.items():
            self.assertEqual(parts[part], self.folder.read(name), part)
        self.assertEqual(set(parts), {*PARTS, "bank"})
        answer = self.run_ok("info", "recorded.lcm")
        self.assertNotIn("INCOMPLETE", answer.out)
        self.assertNotIn("MISSING", answer.out)

    def test_both_logs_are_complete_and_the_same(self):
        self.record()
        contents = []
        for log in ("own.lcm", "recorded.lcm"):
            result = json.loads(self.run_ok("log", "check", log, "--json", "-").out)
            self.assertTrue(result["complete"], log)
            (run,) = result["runs"]
            for channel in run["channels"].values():  # RUN may come again on live LCM
                self.assertEqual((channel["missing"], channel["differing_repeats"]), (0, 0))
                channel.pop("repeats")
            contents.append(run)
        self.assertEqual(*contents)

    def test_a_logger_that_comes_late_has_all_from_there(self):
        self.folder.patch("short.toml", ("duration_s = 2.0", "duration_s = 6.5"))
        run = self.folder.start("run", "short.toml", "--realtime", "--lcm", URL, "--log", "own.lcm", "--quiet")
        self.addCleanup(lambda: run.poll() is None and (run.kill(), run.communicate()))
        wait_for(lambda: self.folder.logs() and os.path.getsize(self.folder.logs()[0]) > 20000)
        logger = self.start_logger()
        self.assertEqual(finish(run).code, 0)
        own = read_log(self.folder.file("own.lcm"))[0]
        wait_for(lambda: read_log(self.folder.file("recorded.lcm"))[0][-1].data == own[-1].data)
        logger.send_signal(signal.SIGINT)
        self.assertEqual(finish(logger).code, 0)
        # What the run was made from came again while the logger listened.
        answer = self.folder.run("log", "check", "recorded.lcm", "--json", "-")
        self.assert_code(1, answer)
        (found,) = json.loads(answer.out)["runs"]
        self.assertEqual((found["begins_late"], found["ended"], found["no_gaps"]), (True, True, True), answer.err)
        self.assertTrue(all(part["whole"] for part in found["parts"]))
        self.assertRegex(answer.err, r"the log begins at cycle \d+; complete from there")


if __name__ == "__main__":
    enter_namespace(__file__)
    unittest.main()
