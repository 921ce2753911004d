#!/usr/bin/python3
"""`faultline play` to SocketCAN, diagnosed there by `faultline diagnose`: run inside tools/with-vcan -i vcan0."""
import json
import re
import subprocess
import unittest

from faultline_program import FolderTest, decode_all, finish, read_log, wait_for

RESULTS = ["FAULTLINE_SAMPLE", "FAULTLINE_RESIDUAL", "FAULTLINE_DIAGNOSIS", "FAULTLINE_ESTIMATE"]
COUNTERS = ("utime", "sequence")


class PlaybackOnCan(FolderTest):
    def setUp(self):
        super().setUp()
        text = self.folder.read("demo.toml").decode()
        text = text[:text.index("[[expect]]")].replace("duration_s = 10.0", "duration_s = 3.0")
        self.folder.write("short.toml", text.replace("at_s   = 4.0", "at_s   = 2.0"))
        self.run_ok("run", "short.toml", "--log", "own.lcm")

    @staticmethod
    def receivers():
        """Filters of CAN_RAW sockets on vcan0, whatever the kernel's list they are in."""
        count = 0
        for name in ("all", "sff", "eff", "fil", "inv"):
            with open(f"/proc/net/can/rcvlist_{name}", encoding="ascii") as file:
                count += len(re.findall(r"^\s+vcan0 .*\braw$", file.read(), re.MULTILINE))
        return count

    def messages(self, file):
        messages = decode_all(read_log(self.folder.file(file))[0])
        return {channel: [{name: value for name, value in message.items() if name not in COUNTERS}
                          for message in messages[channel]] for channel in [*RESULTS, "FAULTLINE_CAN"]}

    def test_a_played_run_is_diagnosed_alike(self):
        self.run_ok("design", "bank.toml", "-o", "pairs.bank.json")
        process = self.folder.start("diagnose", "--from", "can:vcan0", "--bank", "pairs.bank.json", "--dbc",
                                    "bench.dbc", "--idle", "3", "--log", "out.lcm")
        self.addCleanup(lambda: process.poll() is None and (process.kill(), process.communicate()))
        wait_for(lambda: self.receivers() >= 5)  # the messages of the DBC
        played = json.loads(self.run_ok("play", "own.lcm", "--bus", "can:vcan0", "--json", "-").out)
        self.assert_code(0, finish(process))
        self.assertEqual((played["sent"], played["refused"]), (301 * 5, 0))
        own, found = self.messages("own.lcm"), self.messages("out.lcm")
        for channel in RESULTS:
            self.assertTrue(own[channel], channel)
            self.assertTrue(repr(found[channel]) == repr(own[channel]), f"{channel}: a message differs")
        keys = ("id", "flags", "length", "data")
        frames = [[[frame[key] for key in keys] for batch in messages["FAULTLINE_CAN"] for frame in batch["frames"]]
                  for messages in (own, found)]
        self.assertEqual(frames[0], frames[1])

    @staticmethod
    def set_mtu(size):
        for change in (["down"], ["mtu", str(size)], ["up"]):
            subprocess.run(["ip", "link", "set", "vcan0", *change], check=True)

    def test_what_the_bus_refuses_is_counted_and_the_rest_sent(self):
        self.folder.write("fd.log", f"(1.0) vcan0 101#01\n(1.0) vcan0 102##1{'00' * 12}\n(1.1) vcan0 103#\n")
        self.addCleanup(self.set_mtu, 72)
        self.set_mtu(16)  # classic frames only
        answer = self.folder.run("play", "fd.log", "--bus", "can:vcan0", "--json", "result.json")
        self.assert_code(3, answer)
        result = json.loads(self.folder.read("result.json"))
        self.assertEqual((result["sent"], result["refused"]), (2, 1))
        self.assertIn("REFUSED  can:vcan0: ", answer.out)


if __name__ == "__main__":
    unittest.main()
