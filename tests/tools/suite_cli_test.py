#!/usr/bin/python3
"""`faultline run` with many scenarios, includes, JUnit XML: as a user and as a CI system meet them."""
import fcntl
import json
import os
import pty
import shutil
import signal
import struct
import subprocess
import termios
import time
import unittest
import xml.etree.ElementTree as ElementTree

from faultline_program import ROOT, FolderTest, decode_all, finish, program, read_log, reassemble_parts, wait_for

COMMON = """schema = 1
plant  = "../plant.toml"
bank   = "../bank.toml"
dbc    = "../bench.dbc"
duration_s = 10.0

[controller]
kind = "lqr"
feedforward = [1.0, 1.0, 1.0, 1.0]

[[expect]]
from_s  = 2.0
until_s = 3.99
verdict = "healthy"
"""

INCLUDING = """name = "including"
include = ["parts/common.toml"]

[[fault]]
target = "u2"
kind   = "bias"
at_s   = 4.0
value  = 2.0

[[expect]]
from_s   = 4.0
until_s  = 10.0
verdict  = "isolated"
faults   = ["u2"]
within_s = 0.3
estimate = { u2 = 2.0 }
tolerance = 0.1
"""

LONG = """name = "long"
include = ["parts/common.toml"]
duration_s = 1e5
[[expect]]
from_s = 10
until_s = 99999
verdict = "healthy"
"""


class SuiteTest(FolderTest):
    """A folder `suite` with what a test writes there, and `parts`, which several scenarios include."""

    def setUp(self):
        super().setUp()
        os.makedirs(self.folder.file("suite/parts"))
        self.folder.write("suite/parts/common.toml", COMMON.replace("../", "../../"))

    def write(self, name, text):
        self.folder.write(f"suite/{name}", text)

    def junit(self, name="junit.xml"):
        return ElementTree.fromstring(self.folder.read(name).decode())


class Suite(SuiteTest):
    def test_runs_all_scenarios_of_a_folder_and_tells_them_in_one_table(self):
        self.write("b.toml", INCLUDING)
        self.write("deeper.txt", "no scenario")
        os.makedirs(self.folder.file("suite/deeper"))
        self.write("deeper/a.toml", INCLUDING.replace("parts", "../parts").replace("including", "deep"))
        answer = self.run_ok("run", "suite", "demo.toml", "--json", "all.json")
        rows = [line.split()[:3] for line in answer.out.splitlines()[1:4]]
        self.assertEqual(rows, [["including", "2/2", "met"], ["deep", "2/2", "met"], ["demo", "2/2", "met"]])
        self.assertIn("3 scenarios: 3 met; 6 of 6 expectations met", answer.out)
        self.assertIn("isolated u2, u3", answer.out)
        self.assertNotIn("\x1b", answer.out)
        self.assertIn("[2/3] deep  met", answer.err)
        data = json.loads(self.folder.read("all.json"))
        self.assertEqual([each["name"] for each in data["scenarios"]], ["including", "deep", "demo"])
        self.assertEqual(data["total"]["expectations_met"], 6)
        self.assertTrue(all(each["summary"]["expect"]["met"] for each in data["scenarios"]))
        self.assertEqual(self.folder.logs(), [], "logs only where they are asked for")

    def test_is_silent_where_it_is_told_to_be(self):
        self.assertEqual(self.run_ok("run", "suite/parts/../../demo.toml", "fig05.toml", "-q").err, "")

    def test_counts_a_file_that_is_named_twice_once(self):
        self.assertIn("1 scenario: 1 met", self.run_ok("run", "demo.toml", "./demo.toml").out)

    def test_exit_code_says_whether_an_expectation_was_not_met(self):
        self.write("a.toml", INCLUDING.replace("u2 = 2.0", "u2 = 3.0"))
        self.write("b.toml", INCLUDING)
        answer = self.folder.run("run", "suite")
        self.assert_code(1, answer)
        self.assertRegex(answer.out, r"suite/a.toml\n    NOT MET 4 .. 10 s  isolated u2 within 0.3 s; u2 = 3 \+- 0.1 "
                                     r"\(after \d+ ms\)|found u2 = ")
        self.assertIn("2 scenarios: 1 met, 1 NOT MET; 3 of 4 expectations met", answer.out)

    def test_runs_the_others_where_one_is_bad(self):
        self.write("a.toml", INCLUDING.replace("within_s", "withn_s"))
        self.write("b.toml", INCLUDING.replace("u2 = 2.0", "u2 = 3.0"))
        self.write("c.toml", INCLUDING)
        self.write("d.toml", "name = [\n")
        answer = self.folder.run("run", "suite", "--junit", "junit.xml")
        self.assert_code(2, answer)
        self.assertIn('suite/a.toml:15:1: expect, entry 2: found unknown key "withn_s"; did you mean "within_s"?',
                      answer.out)
        self.assertIn("not TOML", answer.out)
        self.assertIn("4 scenarios: 1 met, 1 NOT MET, 2 not run; 3 of 4 expectations met", answer.out)
        root = self.junit()
        self.assertEqual([suite.get("name") for suite in root], ["a", "including", "including", "d"])
        self.assertEqual((root.get("errors"), root.get("failures"), root.get("tests")), ("2", "1", "6"))

    def test_refuses_what_makes_no_sense(self):
        os.makedirs(self.folder.file("empty"))
        for arguments, text in ((["suite"], "found no scenario in it"), (["empty"], "found no scenario in it"),
                                (["demo.toml", "nowhere"], "nowhere"),
                                (["demo.toml", "fig05.toml", "--log", "x.lcm"], "--log-dir"),
                                (["demo.toml", "--log", "x.lcm", "--log-dir", "logs"], "--log"),
                                (["demo.toml", "--json", "-", "--junit", "-"], "--junit: found -")):
            with self.subTest(arguments=arguments):
                answer = self.folder.run("run", *arguments)
                self.assert_code(2, answer)
                self.assertIn(text, answer.err)
                self.assertEqual(answer.out, "")
        self.assertEqual(self.folder.logs(), [])

    def test_writes_a_log_for_each_where_it_is_told_to(self):
        self.write("a.toml", INCLUDING)
        self.write("b.toml", INCLUDING)
        self.run_ok("run", "suite", "--log-dir", "logs/of_suite")
        names = [os.path.relpath(log, self.folder.path) for log in self.folder.logs()]
        self.assertEqual(names, ["logs/of_suite/including-2.lcm", "logs/of_suite/including.lcm"])
        self.run_ok("run", "demo.toml", "--log-dir", "logs")
        self.assertIn(self.folder.file("logs/demo.lcm"), self.folder.logs())

    def test_table_fits_the_terminal_and_is_coloured_only_there(self):
        for columns, environment, has_colour in ((80, {}, True), (160, {}, True), (160, {"NO_COLOR": "1"}, False)):
            with self.subTest(columns=columns, environment=environment):
                out = self.in_terminal(columns, {**self.folder.environment, "TERM": "xterm", **environment})
                self.assertEqual("\x1b[32m" in out, has_colour)
                for line in out.splitlines():
                    self.assertLessEqual(len(line.replace("\x1b[32m", "").replace("\x1b[0m", "")), columns)
                self.assertIn("50.08 isolated u2, u3", out)

    def in_terminal(self, columns, environment):
        """What `faultline run` prints to a terminal of so many columns."""
        master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        process = subprocess.Popen([program(), "run", "-q", "fig13.toml", "fig16.toml"], cwd=self.folder.path,
                                   env=environment, stdin=subprocess.DEVNULL, stdout=slave)
        os.close(slave)
        out = b""
        try:
            while chunk := os.read(master, 65536):
                out += chunk
        except OSError:
            pass  # Linux: the other side is closed
        os.close(master)
        self.assertEqual(process.wait(), 0)
        return out.decode()


class Junit(SuiteTest):
    def test_has_a_suite_per_scenario_and_a_case_per_expectation(self):
        self.write("a.toml", INCLUDING.replace("u2 = 2.0", "u2 = 3.0"))
        answer = self.folder.run("run", "suite", "demo.toml", "--junit", "junit.xml")
        self.assert_code(1, answer)
        root = self.junit()
        self.assertEqual((root.tag, root.get("tests"), root.get("failures"), root.get("errors")),
                         ("testsuites", "4", "1", "0"))
        including, demo = root
        self.assertEqual((including.get("name"), including.get("file")), ("including", "suite/a.toml"))
        self.assertEqual([case.get("name") for case in demo], ["2 .. 3.99 s  healthy", "4.3 .. 10 s  isolated u2, u3"])
        self.assertEqual([case.get("classname") for case in demo], ["demo", "demo"])
        failure = including[1].find("failure")
        self.assertRegex(failure.get("message"), r"^found u2 = 1\.9\d+|2\.0\d* at 10 s$")
        self.assertIsNone(including[0].find("failure"))
        for case in root.iter("testcase"):
            self.assertGreaterEqual(float(case.get("time")), 0)

    def test_of_a_single_run_and_on_stdout(self):
        answer = self.run_ok("run", "demo.toml", "-q", "--no-log", "--junit", "-")
        self.assertEqual(ElementTree.fromstring(answer.out).get("tests"), "2")
        self.assertIn("expectations", answer.err)

    def test_of_a_scenario_that_cannot_be_run(self):
        self.write("a.toml", "name = [\n")
        self.assert_code(2, self.folder.run("run", "suite/a.toml", "--junit", "junit.xml"))
        error = self.junit()[0][0].find("error")
        self.assertIn("not TOML", error.get("message"))
        self.assertEqual(self.junit().get("errors"), "1")

    def test_is_well_formed_whatever_the_name(self):
        odd = '<&>"\\u0001\\t\\n\\u00e9\\U0001F600 ]]>'
        self.write("a.toml", INCLUDING.replace('"including"', '"' + odd.replace('"\\u', '\\"\\u') + '"'))
        self.run_ok("run", "suite", "--junit", "junit.xml")
        self.assertEqual(self.junit()[0].get("name"), '<&>"\ufffd\t\n\u00e9\U0001F600 ]]>')

    def test_of_a_plant_that_diverges(self):
        self.write("a.toml", INCLUDING.replace("[[fault]]", '[controller]\nkind = "none"\n\n[[fault]]', 1)
                   .replace("include =", "duration_s = 1000\ninclude ="))
        answer = self.folder.run("run", "suite", "--junit", "junit.xml")
        self.assert_code(1, answer)
        suite = self.junit()[0]
        self.assertEqual((suite.get("errors"), suite.get("tests")), ("1", "3"))
        self.assertIn("stopped: ", suite[-1].find("error").get("message"))
        self.assertIn("STOPPED", answer.out)


class Interrupt(SuiteTest):
    def test_ends_with_the_table_so_far(self):
        self.write("a.toml", INCLUDING)
        self.write("b.toml", LONG)
        self.write("c.toml", INCLUDING)
        for number in (signal.SIGINT, signal.SIGTERM):
            with self.subTest(signal=number):
                process = self.folder.start("run", "suite", "--junit", "junit.xml", "--json", "all.json",
                                            "--log-dir", "logs")
                wait_for(lambda: os.path.exists(self.folder.file("logs/long.lcm")))
                process.send_signal(number)
                answer = finish(process)
                self.assert_code(128 + number, answer)
                self.assertRegex(answer.out, r"including +2/2 met")
                self.assertRegex(answer.out, r"long +\d/2 INTERRUPTED")
                self.assertIn(f"STOPPED by signal {int(number)}, 1 not begun", answer.out)
                root = self.junit()
                self.assertEqual((root.get("errors"), root.get("failures")), ("1", "0"))
                self.assertIsNotNone(root[1][1].find("skipped"), "nobody knows whether it would have been met")
                data = json.loads(self.folder.read("all.json"))
                self.assertTrue(data["interrupted"])
                self.assertEqual(data["not_begun"], 1)
                os.remove(self.folder.file("logs/long.lcm"))

    def test_while_a_bank_is_designed_nothing_is_written(self):
        """An observer of which the design takes seconds; a thread of its own designs it."""
        example = f"{ROOT}/examples/ma2024"
        for name in ("plant.toml", "bank.toml", "bench.dbc", "healthy.toml"):
            shutil.copy(os.path.join(example, name), self.folder.file("suite"))
        for scenarios in ("suite/healthy.toml", "suite"):
            for number in (signal.SIGINT, signal.SIGTERM):
                with self.subTest(scenarios=scenarios, signal=number):
                    process = self.folder.start("run", scenarios, "--junit", "one.xml", "--json", "one.json",
                                                "--log-dir", "logs")
                    wait_for(lambda: len(os.listdir(f"/proc/{process.pid}/task")) > 1)
                    process.send_signal(number)
                    answer = finish(process)
                    self.assert_code(128 + number, answer)
                    self.assertRegex(answer.out + answer.err, f"(?i)stopped by signal {int(number)}")
                    self.assertFalse(os.path.exists(self.folder.file("logs/ma2024.lcm")))
                    if scenarios == "suite":
                        root = ElementTree.fromstring(self.folder.read("one.xml").decode())
                        self.assertEqual(root.get("tests"), "0", "whole, and of what was run alone")
                        self.assertEqual(json.loads(self.folder.read("one.json"))["not_begun"], 1)
                    else:
                        self.assertFalse(os.path.exists(self.folder.file("one.xml")))
                        self.assertFalse(os.path.exists(self.folder.file("one.json")))


class Include(SuiteTest):
    def test_a_log_carries_what_was_included_and_is_replayed_from_it_alone(self):
        self.write("a.toml", INCLUDING)
        self.run_ok("run", "suite/a.toml", "--log", "run.lcm")
        parts = reassemble_parts(decode_all(read_log(self.folder.file("run.lcm"))[0])["FAULTLINE_RUN"])
        self.assertEqual(list(parts)[:2], ["scenario", "include:parts/common.toml"])
        self.assertEqual(parts["include:parts/common.toml"], self.folder.read("suite/parts/common.toml"))
        os.remove(self.folder.file("suite/a.toml"))
        os.remove(self.folder.file("suite/parts/common.toml"))
        answer = self.run_ok("replay", "run.lcm")
        self.assertIn("isolated u2 within 0.3 s", answer.out)

    def test_info_tells_what_a_scenario_includes_and_expects(self):
        self.write("a.toml", INCLUDING)
        out = self.run_ok("info", "suite/a.toml", "--json", "info.json").out
        for text in ("includes parts/common.toml", "2 .. 3.99 s  healthy",
                     "4 .. 10 s  isolated u2 within 0.3 s; u2 = 2 +- 0.1", "fault u2"):
            self.assertIn(text, out)
        data = json.loads(self.folder.read("info.json"))
        self.assertEqual(data["includes"], ["parts/common.toml"])
        self.assertEqual(data["expect"], ["2 .. 3.99 s  healthy",
                                          "4 .. 10 s  isolated u2 within 0.3 s; u2 = 2 +- 0.1"])
        part = self.run_ok("info", "suite/parts/common.toml").out
        self.assertIn("a part that scenarios include", part)

    def test_an_error_in_an_included_file_points_there(self):
        self.folder.write("suite/parts/common.toml", COMMON.replace("../", "../../").replace("from_s  = 2.0", "from_s = -2"))
        self.write("a.toml", INCLUDING)
        answer = self.folder.run("run", "suite/a.toml")
        self.assert_code(2, answer)
        self.assertIn("suite/parts/common.toml:12:10: expect, entry 1.from_s: found -2", answer.err)


class Start(SuiteTest):
    """Where a run begins, and how its channels are found on the bus."""

    def states(self, log):
        return [truth["x"] for truth in decode_all(read_log(self.folder.file(log))[0])["FAULTLINE_TRUTH"]]

    def test_states_are_given_by_name(self):
        self.write("a.toml", INCLUDING.replace("[[fault]]", "[initial_state]\nx2 = 0.5\nx1 = -0.25\n\n[[fault]]", 1))
        self.run_ok("run", "suite/a.toml", "--log", "run.lcm")
        self.assertEqual(self.states("run.lcm")[0], [-0.25, 0.5, 0.0])
        self.assertIn("starts at x1 = -0.25, x2 = 0.5", self.run_ok("info", "suite/a.toml").out)

    def test_a_state_that_the_plant_does_not_have(self):
        self.write("a.toml", INCLUDING.replace("[[fault]]", "[initial_state]\nx4 = 0.5\n\n[[fault]]", 1))
        answer = self.folder.run("run", "suite/a.toml")
        self.assert_code(2, answer)
        self.assertIn('suite/a.toml:5:6: initial_state: found "x4", expected a state of plant "hou2015" (x1, x2, x3); '
                      'did you mean "x1"?', answer.err)

    def test_a_sensor_that_is_scaled_and_negated_on_the_bus(self):
        """y1 = -2 * signal + 0.5: the bus carries (0.5 - y1) / 2, and the diagnosis sees y1."""
        self.write("a.toml", INCLUDING)
        self.write("b.toml", INCLUDING.replace('"including"', '"mapped"') +
                   '[signals]\ny1 = { signal = "y1", scale = 2.0, sign = -1, offset = 0.5 }\n')
        self.run_ok("run", "suite", "--log-dir", "logs")
        plain, mapped = (decode_all(read_log(self.folder.file(f"logs/{name}.lcm"))[0])
                         for name in ("including", "mapped"))
        for a, b in zip(plain["FAULTLINE_SAMPLE"], mapped["FAULTLINE_SAMPLE"], strict=True):
            self.assertAlmostEqual(a["y"][0], b["y"][0], delta=1e-3)
        on_bus = [int.from_bytes(bytes(frame["data"][:3]), "little", signed=True) * 1e-4
                  for batch in mapped["FAULTLINE_CAN"] for frame in batch["frames"] if frame["id"] == 272]
        for signal_value, sample in zip(on_bus, mapped["FAULTLINE_SAMPLE"], strict=True):
            self.assertAlmostEqual(0.5 - 2 * signal_value, sample["y"][0], delta=1e-9)
        self.assertIn("signal y1 = -2 * y1 + 0.5", self.run_ok("info", "suite/b.toml").out)


if __name__ == "__main__":
    unittest.main()
