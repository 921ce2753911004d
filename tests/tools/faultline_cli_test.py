#!/usr/bin/python3
"""The program `faultline` itself: help, version, bad usage."""
import unittest

from faultline_program import FolderTest


class Help(FolderTest):
    def test_help_of_the_program_names_commands_and_exit_codes(self):
        out = self.run_ok("--help").out
        for word in ("run", "design", "check", "info", "--version", "Exit codes"):
            self.assertIn(word, out)

    def test_help_of_every_command_names_its_options(self):
        options = {"run": ["SCENARIO", "--bus", "--realtime", "--overrun", "--priority", "--cpu", "--probe", "--log", "--no-log",
                           "--lcm", "--json", "--quiet"],
                   "doctor": ["--json"],
                   "design": ["BANK", "--output", "--json"],
                   "check": ["BANK", "--plant", "--json"],
                   "info": ["FILE", "--json"]}
        for command, names in options.items():
            out = self.run_ok(command, "--help").out
            for name in [*names, "--help", "Exit codes"]:
                self.assertIn(name, out, command)

    def test_version(self):
        self.assertRegex(self.run_ok("--version").out, r"^faultline \d+\.\d+\.\d+\n$")

    def test_bad_usage(self):
        for arguments in ([], ["nonsense"], ["--nonsense"], ["run"], ["design"], ["check"], ["info"], ["run", "--nonsense", "x"],
                          ["run", "demo.toml", "more.toml"], ["run", "demo.toml", "--log"],
                          ["run", "demo.toml", "--log", "a.lcm", "--no-log"],
                          ["run", "demo.toml", "--bus", "vcan0"], ["run", "demo.toml", "--bus", "can:"],
                          ["run", "demo.toml", "--realtime", "--overrun", "never"],
                          ["run", "demo.toml", "--realtime", "--priority", "100"],
                          ["run", "demo.toml", "--realtime", "--cpu", "-1"],
                          ["run", "demo.toml", "--overrun", "skip"], ["run", "demo.toml", "--probe"]):
            with self.subTest(arguments=arguments):
                answer = self.folder.run(*arguments)
                self.assert_code(2, answer)
                self.assertEqual(answer.out, "")
                self.assertNotEqual(answer.err, "")
        self.assertEqual(self.folder.logs(), [])


if __name__ == "__main__":
    unittest.main()
