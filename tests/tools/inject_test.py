#!/usr/bin/python3
"""`faultline inject`: faults begin and end in a run while it goes on, and a replay of its log knows them.

In a network namespace of its own.
"""
import json
import os
import signal
import socket
import struct
import unittest

from faultline_program import FolderTest, decode_all, finish, read_log, wait_for
from multicast_namespace import URL, enter_namespace

BUS = "udp:239.74.163.2:43113"
GROUP, PORT = "239.255.76.67", 7667
CHANNEL = b"FAULTLINE_INJECT\0"
LCM_SHORT = 0x4C433032  # magic of a message in one datagram


def send_raw(*payloads):
    """Publishes bytes that need not be an inject_t."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        for number, payload in enumerate(payloads):
            sender.sendto(struct.pack(">II", LCM_SHORT, number) + CHANNEL + payload, (GROUP, PORT))


class Inject(FolderTest):
    def setUp(self):
        super().setUp()
        text = self.folder.read("nodes.toml").decode()
        self.folder.write("healthy.toml", text[:text.index("[[fault]]")].replace("duration_s = 10.0",
                                                                                  "duration_s = 100000.0"))

    def start_run(self, *arguments, command="run"):
        """A run that ends when it is told to; returns once it listens."""
        err = open(self.folder.file("run.err"), "w+b")
        self.addCleanup(err.close)
        process = self.folder.start(command, "healthy.toml", "--log", "run.lcm", "--lcm", URL, *arguments, stderr=err)
        self.addCleanup(lambda: process.poll() is None and (process.kill(), process.communicate()))
        # LCM asks nobody: the first request that is answered was heard.
        wait_for(lambda: process.poll() is not None or self.inject("--clear", "--wait", "0.5").code == 0)
        self.assertIsNone(process.poll())
        return process

    def inject(self, *arguments):
        return self.folder.run("inject", *arguments, "--lcm", URL)

    def accepted(self, *arguments):
        """The cycle from which it acts."""
        answer = self.inject(*arguments, "--json", "answer.json")
        self.assert_code(0, answer)
        result = json.loads(self.folder.read("answer.json"))
        self.assertTrue(result["answered"] and result["accepted"])
        self.assertIn(f"from cycle {result['cycle']} ", result["text"])
        return result["cycle"]

    def messages(self):
        return decode_all(read_log(self.folder.file("run.lcm"))[0])

    def await_verdict(self, verdict, faults, after):
        def is_there():
            return any(message["verdict"] == verdict and message["cycle"] >= after
                       and [entry["faults"] for entry in message["sets"] if entry["faults"]] == faults
                       for message in self.messages()["FAULTLINE_DIAGNOSIS"])
        wait_for(is_there, period_s=0.1)

    def stop(self, process, code):
        process.send_signal(signal.SIGINT)
        self.assertEqual(finish(process).code, code)

    def check_one_fault(self, *how):
        process = self.start_run(*how)
        begin = self.accepted("u2", "bias", "2")
        self.await_verdict("isolated", [["u2"]], begin)
        end = self.accepted("--clear", "u2")
        self.await_verdict("healthy", [], end)
        self.stop(process, 128 + signal.SIGINT)
        acting = [truth["cycle"] for truth in self.messages()["FAULTLINE_TRUTH"]
                  if truth["faults"] == [{"target": "u2", "kind": "bias", "value": 2.0}]]
        self.assertEqual(acting[0], begin)
        self.assertLess(acting[-1], end)
        # A replay has it.
        replayed = self.run_ok("replay", "run.lcm", "--verify", "--json", "replay.json")
        self.assertIn("bias 2 on u2", replayed.out)
        run = json.loads(self.folder.read("replay.json"))["runs"][0]
        self.assertTrue(run["verification"]["verified"])
        self.assertEqual(run["faults"], [{"target": "u2", "kind": "bias", "value": 2.0, "from_cycle": begin,
                                          "until_cycle": end}])

    def test_in_real_time(self):
        self.check_one_fault("--realtime", "--bus", BUS)

    def test_in_lock_step(self):
        self.check_one_fault("--bus", BUS)

    def test_a_plant_of_its_own_takes_its_faults_only(self):
        process = self.start_run("--bus", BUS, "--forever", command="plant")
        begin = self.accepted("u3", "stuck", "0.5", "--for", "0.1")
        for target, kind in (("Commands1", "dropped"), ("controller", "bus_off"), ("u1", "frozen")):
            refused = self.inject(target, kind)
            self.assert_code(2, refused)
            self.assertIn("which is for the controller", refused.err)
        wait_for(lambda: any(truth["cycle"] >= begin + 5 for truth in self.messages()["FAULTLINE_TRUTH"]))
        self.stop(process, 0)
        cycles = [(truth["cycle"], len(truth["faults"])) for truth in self.messages()["FAULTLINE_TRUTH"]]
        self.assertIn((begin, 1), cycles)
        self.assertIn((begin + 5, 0), cycles)

    def test_refusals_and_nobody(self):
        answer = self.inject("u2", "bias", "1", "--wait", "0.2")
        self.assert_code(3, answer)
        self.assertIn("nobody answered", answer.err)
        process = self.start_run("--realtime", "--bus", BUS)
        for arguments, text in ((("u22", "bias", "1"), 'did you mean "u2"?'),
                                (("u2", "biass", "1"), 'did you mean "bias"?'),
                                (("u2", "bias"), "value: "),
                                (("Sync", "frozen_counter"), "alive counter"),
                                (("u2", "bias", "1", "--probability", "2"), "probability: "),
                                (("u2", "stuck", "--ramp", "1"), "ramp_s: "),
                                (("x" * 1000, "bias", "1"), "1000 bytes"),
                                (("--clear", "u2"), "no fault acts")):
            refused = self.inject(*arguments)
            self.assert_code(2, refused)
            self.assertIn(text, refused.err)
        for arguments in (("u2",), (), ("--clear", "u2", "bias"), ("u2", "bias", "nan")):
            self.assert_code(2, self.inject(*arguments))
        self.stop(process, 128 + signal.SIGINT)

    def test_hostile_messages_do_not_hurt_the_run(self):
        process = self.start_run("--realtime", "--bus", BUS)
        send_raw(b"", b"\0" * 7, b"\0" * 8, os.urandom(100), b"\xff" * 60000, b"\x7f" * 500)
        for _ in range(20):
            send_raw(*[os.urandom(40) for _ in range(500)])
        # Two at once, both answered, once the second of the flood is over.
        wait_for(lambda: self.inject("--clear", "--wait", "0.5").code == 0)
        both = [self.folder.start("inject", target, "bias", "2", "--lcm", URL) for target in ("u1", "u4")]
        self.assertEqual([finish(one).code for one in both], [0, 0])
        wait_for(lambda: any(sorted(fault["target"] for fault in truth["faults"]) == ["u1", "u4"]
                             for truth in self.messages()["FAULTLINE_TRUTH"]))
        self.stop(process, 128 + signal.SIGINT)
        events = [event["text"] for event in self.messages()["FAULTLINE_EVENT"] if event["source"] == "inject"]
        self.assertTrue(any("found a damaged message" in text for text in events), events[:5])
        self.assertTrue(any("were not looked at" in text for text in events), events[-5:])
        self.assertLess(len(events), 1000)
        self.run_ok("replay", "run.lcm", "--verify", "-q")


if __name__ == "__main__":
    enter_namespace(__file__)
    unittest.main()
