#!/usr/bin/python3
"""`faultline doctor` in network namespaces of its own, with and without multicast.

What a check of the machine itself finds (rights, clocks, timers) is the machine's; only that it is told is tested.
"""
import json
import os
import subprocess
import unittest

from faultline_program import PATIENCE_S, finish, program

TWO_COMMANDS = ["ip link set lo up multicast on", "ip route add 224.0.0.0/4 dev lo"]
CHECKS = ["CAN in the kernel", "CAN interfaces", "multicast", "LCM round trip", "lcm-logger", "receive buffers",
          "input backlog", "CPUs", "real-time priority", "locked memory", "idle CPUs", "real-time share", "CPU frequency",
          "clock", "1 ms timer"]


def in_namespace(set_up, *arguments):
    """The program in a new network namespace, after the shell commands `set_up`."""
    own = ["--net"] if os.geteuid() == 0 else ["--net", "--map-root-user"]
    path = os.environ["PATH"] + ":/usr/sbin:/sbin"
    process = subprocess.Popen(
        ["unshare", *own, "sh", "-e", "-c", "\n".join(set_up) + '\nexec "$@"', "sh", program(), "doctor", *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, "PATH": path})
    return finish(process, PATIENCE_S)


def checks(answer):
    """{check: {status, found, type}} of --json -."""
    return {entry["check"]: entry for entry in json.loads(answer.out)["checks"]}


class Doctor(unittest.TestCase):
    def test_says_the_two_commands_where_there_is_no_multicast(self):
        answer = in_namespace([])
        self.assertEqual(answer.code, 1, answer.err)
        self.assertIn("[FAIL] multicast", answer.out)
        self.assertIn("[FAIL] LCM round trip", answer.out)
        for command in TWO_COMMANDS:
            self.assertIn(f"$ {command}\n", answer.out)
        self.assertIn("missing", answer.out.splitlines()[-1])
        # lo alone is not enough.
        found = checks(in_namespace(["ip link set lo up"], "--json", "-"))
        self.assertEqual(found["multicast"]["status"], "FAIL")
        self.assertEqual(found["multicast"]["type"], TWO_COMMANDS)

    def test_tells_a_route_by_a_loopback_without_multicast(self):
        found = checks(in_namespace(["ip link set lo up multicast off", TWO_COMMANDS[1]], "--json", "-"))
        self.assertEqual(found["multicast"]["status"], "FAIL")
        self.assertEqual(found["multicast"]["type"], TWO_COMMANDS[:1])

    def test_is_content_once_they_were_typed(self):
        answer = in_namespace(TWO_COMMANDS, "--json", "-")
        found = checks(answer)
        self.assertEqual(list(found), CHECKS)
        self.assertEqual(found["multicast"]["status"], "ok", answer.out)
        self.assertEqual(found["LCM round trip"]["status"], "ok", answer.out)
        fails = [entry for entry in found.values() if entry["status"] == "FAIL"]
        self.assertEqual(json.loads(answer.out)["fit"], not fails)
        self.assertEqual(answer.code, 1 if fails else 0)
        for entry in found.values():
            self.assertTrue(entry["found"])
            self.assertIn(entry["status"], ("ok", "warn", "FAIL"))
        # People are told all the same, on stderr.
        for check in CHECKS:
            self.assertIn(check, answer.err)

    def test_refuses_what_it_does_not_know(self):
        self.assertEqual(in_namespace([], "--nonsense").code, 2)


if __name__ == "__main__":
    unittest.main()
