#!/usr/bin/python3
"""Runs with alive counters and checksums as a user meets them; frames are checked by an implementation of their own."""
import json
import os
import sys
import unittest

from faultline_program import ROOT, FolderTest, decode_all, read_log

sys.path.insert(0, os.path.join(ROOT, "tests", "golden", "e2e"))
import make_golden as e2e  # noqa: E402

MESSAGES = ["Sensors1", "Sensors2", "Commands1", "Commands2", "Sync"]


def low_nibble(byte):
    return byte & 0xF


# By identifier: the frame's counter, the checksum it carries, the checksum it should carry, the length of the sequence.
CHECKS = {
    256: lambda d: (d[10], d[8] | d[9] << 8, e2e.profile_5(d, 8, 4660), 256),
    272: lambda d: (low_nibble(d[1]), d[0], e2e.profile_1(d, 0, 291, 0, "C"), 15),
    273: lambda d: (low_nibble(d[1]), d[0], e2e.profile_1(d, 0, 292, 0, "A"), 15),
    288: lambda d: (low_nibble(d[6]), d[7], e2e.j1850(d, 7), 16),
    289: lambda d: (low_nibble(d[6]), d[7], e2e.j1850(d, 7), 16),
}


class ProtectedRun(FolderTest):
    def test_every_frame_is_what_the_specification_asks_for(self):
        self.run_ok("run", "protected.toml", "--log", "own.lcm")
        events, rest = read_log(self.folder.file("own.lcm"))
        self.assertEqual(rest, 0)
        frames = [frame for batch in decode_all(events)["FAULTLINE_CAN"] for frame in batch["frames"]]
        self.assertEqual(len(frames), 5005)
        seen = {}
        for frame in frames:
            data = bytes(byte & 0xFF for byte in frame["data"])
            counter, carried, expected, sequence = CHECKS[frame["id"]](data)
            self.assertEqual(carried, expected, frame)
            if frame["id"] in seen:
                self.assertEqual(counter, (seen[frame["id"]] + 1) % sequence, frame)
            seen[frame["id"]] = counter
            if frame["id"] == 272:
                self.assertEqual(data[1] >> 4, 291 >> 8)
        self.assertEqual(sorted(seen), sorted(CHECKS))

    def test_the_result_counts_every_message(self):
        run = json.loads(self.run_ok("run", "protected.toml", "--json", "-").out)
        self.assertIs(run["expect"]["met"], True)
        self.assertEqual([message["message"] for message in run["messages"]], MESSAGES)
        for message in run["messages"]:
            self.assertEqual(message.pop("frames"), 1001)
            message.pop("message")
            self.assertEqual(set(message.values()), {0})
        self.assertEqual(run["verdicts"][0]["blame"], "")

    def test_a_wrong_description_is_refused_where_it_stands(self):
        text = self.folder.read("bench_protected.dbc").decode()
        line = {name: 1 + text[:text.index(f"BO_ {number} {name}")].count("\n")
                for number, name in ((272, "Sensors1"), (273, "Sensors2"), (288, "Commands1"))}
        for old, new, where, what in (
                ('BA_ "FaultlineDataId" BO_ 273 292;', "", f"{line['Sensors2']}:5:",
                 "protection E2E_P01A needs the attribute FaultlineDataId, found none of its own"),
                ('BA_ "FaultlineDataId" BO_ 272 291;', 'BA_ "FaultlineDataId" BO_ 272 4096;',
                 f"{line['Sensors1']}:5:", "found FaultlineDataId 4096, expected an integer of 0 .. 4095"),
                ('BA_ "FaultlineRole" SG_ 288 Commands1Crc 5;', "", f"{line['Commands1']}:5:",
                 "protection J1850 needs a signal of role crc, found none"),
                ('BA_ "FaultlineProtection" BO_ 288 1;', "", f"{line['Commands1'] + 5}:6:",
                 "signal Commands1.Commands1Crc has the role crc, and its message FaultlineProtection none")):
            with self.subTest(what):
                self.assertEqual(text.count(old), 1)
                self.folder.write("bench_protected.dbc", text.replace(old, new))
                answer = self.folder.run("run", "protected.toml")
                self.assert_code(2, answer)
                self.assertIn(f"bench_protected.dbc:{where}", answer.err)
                self.assertIn(what, answer.err)
                self.assertEqual(self.folder.logs(), [])


if __name__ == "__main__":
    unittest.main()
