#!/usr/bin/python3
"""Plant, controller and two diagnoses, each a process of its own on one bus: any may die and come back.

On UDP in a network namespace of its own; on the bus that NODES_BUS names where it is set (inside tools/with-vcan).
No clock is asked for more than patience: what is awaited is what the nodes say.
"""
import json
import os
import re
import signal
import time
import unittest

from faultline_program import FolderTest, decode_all, finish, read_log, wait_for
from multicast_namespace import enter_namespace

BUS = os.environ.get("NODES_BUS", "udp:239.74.163.2:43113")
PATIENCE_S = 100  # User Mode Linux has one CPU and expensive system calls
SCENARIO = "nodes.toml"
# The last message of each node: a look may come between two, which are then told apart.
NO_COMMANDS, COMMANDS_BACK = r"no [^\n]*Commands2 for", r"Commands2 back after"
NO_PLANT, PLANT_BACK = r"no [^\n]*Sensors2\b[^\n]* for", r"Sensors2\b[^\n]* back after"


class Node:
    """A node that runs, and what it has said so far."""

    def __init__(self, test, name, *arguments):
        self.file = test.folder.file(f"{name}-{time.monotonic_ns()}.out")
        with open(self.file, "wb") as out:
            self.process = test.folder.start(*arguments, stdout=out, stderr=out)
        test.addCleanup(lambda: self.process.poll() is None and (self.process.kill(), self.process.wait()))

    def text(self):
        with open(self.file, encoding="utf-8") as file:
            return file.read()

    def await_text(self, pattern, after=0):
        """Waits until the node has said what matches, behind `after`; returns where that ends."""
        def find():
            match = re.compile(pattern).search(self.text(), after)
            if match is None and self.process.poll() is not None:
                raise AssertionError(f"ended with {self.process.returncode} before /{pattern}/: {self.text()[-2000:]}")
            return match
        try:
            return wait_for(find, PATIENCE_S, 0.05).end()
        except AssertionError as error:
            raise AssertionError(f"{error}: /{pattern}/ behind {after} of: {self.text()[-3000:]}") from None

    def is_running(self):
        return self.process.poll() is None

    def kill(self):
        self.process.kill()
        self.process.wait()

    def end(self):
        self.process.send_signal(signal.SIGTERM)
        return finish(self.process, PATIENCE_S).code


def verdict_at(diagnoses, cycle):
    """The verdict and sets announced at a cycle: each change is one message."""
    last = None
    for message in diagnoses:
        if message["cycle"] > cycle:
            break
        last = (message["verdict"], [entry["faults"] for entry in message["sets"]])
    return last


class Nodes(FolderTest):
    def plant(self, *arguments):
        return Node(self, "plant", "plant", SCENARIO, "--bus", BUS, *arguments)

    def controller(self, *arguments):
        return Node(self, "controller", "controller", SCENARIO, "--bus", BUS, *arguments)

    def diagnosis(self, *arguments):
        return Node(self, "diagnose", "diagnose", SCENARIO, "--from", BUS, *arguments)

    def last_life(self, log):
        """The messages of a log since the plant last began anew: cycles come twice before."""
        messages = decode_all(read_log(self.folder.file(log))[0])
        starts = [i for i, sample in enumerate(messages["FAULTLINE_SAMPLE"])
                  if i > 0 and sample["cycle"] < messages["FAULTLINE_SAMPLE"][i - 1]["cycle"]]
        begin = messages["FAULTLINE_SAMPLE"][starts[-1]]["utime"] if starts else 0
        return {channel: [message for message in messages[channel] if message["utime"] >= begin]
                for channel in ("FAULTLINE_RESIDUAL", "FAULTLINE_DIAGNOSIS", "FAULTLINE_EVENT")}

    def assert_agree(self, undisturbed, restarted):
        """From the first sample on that the restarted diagnosis judged, both must say the same."""
        one, other = self.last_life(undisturbed), self.last_life(restarted)
        first = next(message["cycle"] for message in other["FAULTLINE_DIAGNOSIS"] if message["verdict"] != "inhibited")
        residuals = {message["cycle"]: message for message in one["FAULTLINE_RESIDUAL"]}
        compared = 0
        for message in other["FAULTLINE_RESIDUAL"]:
            cycle = message["cycle"]
            if cycle < first or cycle not in residuals:
                continue
            compared += 1
            self.assertEqual(message["fired"], residuals[cycle]["fired"], cycle)
            for mine, theirs, threshold in zip(message["evaluation"], residuals[cycle]["evaluation"],
                                               message["threshold"]):
                self.assertLess(abs(mine - theirs), 0.01 * threshold, cycle)
            self.assertEqual(verdict_at(other["FAULTLINE_DIAGNOSIS"], cycle),
                             verdict_at(one["FAULTLINE_DIAGNOSIS"], cycle), cycle)
        self.assertGreater(compared, 20)
        self.assertEqual(verdict_at(other["FAULTLINE_DIAGNOSIS"], 1 << 32), ("isolated", [["u2"]]))

    def test_each_node_may_die_and_come_back(self):
        plant = self.plant("--forever")
        controller = self.controller()
        diagnosis = self.diagnosis("--log", "undisturbed.lcm")
        other = self.diagnosis("--log", "killed.lcm")
        for node in (diagnosis, other):
            node.await_text(r"isolated u2")

        # The controller: the plant goes on with the last command.
        at, plant_at = len(diagnosis.text()), len(plant.text())
        controller.kill()
        at = diagnosis.await_text(NO_COMMANDS, at)
        plant_at = plant.await_text(NO_COMMANDS, plant_at)
        controller = self.controller()
        at = diagnosis.await_text(COMMANDS_BACK, at)
        plant.await_text(COMMANDS_BACK, plant_at)

        # The plant: nothing but commands that answer nobody could come; then k begins at 0 again.
        controller.await_text("measurements come")
        plant.kill()
        controller_at = controller.await_text(NO_PLANT)
        at = diagnosis.await_text(NO_PLANT, at)
        plant = self.plant("--forever")
        controller.await_text(r"the plant began anew: cycle \d+ after cycle \d+", controller_at)
        diagnosis.await_text(PLANT_BACK, at)
        at = diagnosis.await_text(r"inhibited", at)
        at = diagnosis.await_text(r"healthy", at)
        diagnosis.await_text(r"isolated u2", at)

        # A diagnosis: a new one agrees with the one that was not disturbed.
        other.kill()
        self.assertTrue(all(node.is_running() for node in (plant, controller, diagnosis)))
        restarted = self.diagnosis("--log", "restarted.lcm")
        restarted.await_text(r"isolated u2")
        time.sleep(2)
        self.assertEqual([node.end() for node in (restarted, diagnosis, controller, plant)], [0, 0, 0, 0])
        self.assert_agree("undisturbed.lcm", "restarted.lcm")
        messages = decode_all(read_log(self.folder.file("undisturbed.lcm"))[0])
        told = [event["text"] for event in messages["FAULTLINE_EVENT"] if event["source"] == "watchdog"]
        self.assertTrue(any(re.search(NO_COMMANDS, text) for text in told), told)
        self.assertTrue(any(re.search(NO_PLANT, text) for text in told), told)

    def test_what_the_nodes_report_at_their_end(self):
        controller = self.controller("--json", "controller.json")
        plant = self.plant("--for", "3", "--json", "plant.json", "--log", "plant.lcm")
        self.assertEqual(finish(plant.process, PATIENCE_S).code, 0)
        self.assertEqual(controller.end(), 0)
        result = json.loads(self.folder.read("plant.json"))
        self.assertEqual((result["cycles"], result["signal"], result["stop_reason"]), (151, 0, None))
        self.assertEqual(result["frames"]["sent"], 151 * 3)
        self.assertEqual(result["faults"], [{"target": "u2", "kind": "bias", "from_cycle": 100}])
        answered = json.loads(self.folder.read("controller.json"))
        self.assertEqual(answered["signal"], signal.SIGTERM)
        self.assertGreater(answered["cycles"], 0)
        self.assertEqual(answered["frames"]["sent"], 2 * answered["cycles"])
        truths = decode_all(read_log(self.folder.file("plant.lcm"))[0])["FAULTLINE_TRUTH"]
        first = next(truth for truth in truths if truth["faults"])
        self.assertEqual((first["cycle"], first["faults"]), (100, [{"target": "u2", "kind": "bias", "value": 2.0}]))

    def test_bad_input_is_told(self):
        for command in ("plant", "controller"):
            answer = self.folder.run(command, SCENARIO, "--bus", "loop", patience_s=PATIENCE_S)
            self.assert_code(2, answer)
            self.assertIn('found "loop", expected can:IFACE', answer.err)
        silent = self.folder.run("controller", SCENARIO, "--bus", BUS, "--for", "0.2", patience_s=PATIENCE_S)
        self.assert_code(1, silent)
        self.folder.patch(SCENARIO, ('plant  = "stable_plant.toml"', 'plant  = "plant.toml"'),
                          ('bank   = "stable_bank.toml"', 'bank   = "bank.toml"'),
                          ("seed   = 1", "seed   = 1\ninitial_state = [1e300, 0.0, 0.0]"))
        self.assert_code(1, self.folder.run("plant", SCENARIO, "--bus", BUS, "--for", "60", patience_s=PATIENCE_S))


if __name__ == "__main__":
    if "NODES_BUS" not in os.environ:
        enter_namespace(__file__)
    unittest.main()
