#!/usr/bin/python3
"""Runs whose bus, file, LCM or standard streams fail."""
import os
import shutil
import subprocess
import unittest

from faultline_program import EXAMPLE, OLD_LOG, FolderTest, finish, program, read_log


class Failures(FolderTest):
    """A bus, a file or LCM that fails: exit 3."""

    def fail(self, *arguments):
        answer = self.folder.run("run", "demo.toml", *arguments)
        self.assert_code(3, answer)
        return answer.err

    def test_an_interface_that_does_not_exist(self):
        err = self.fail("--bus", "can:nosuch0")
        self.assertIn("can:nosuch0", err)
        self.assertRegex(err, "with-vcan|ip link|modprobe")  # what to do
        self.assertEqual(self.folder.logs(), [])

    def test_an_interface_with_an_impossible_name(self):
        self.assertIn("can:", self.fail("--bus", "can:" + "x" * 300))

    def test_an_unwritable_log(self):
        for log in ("nosuch/own.lcm", ".", "/proc/own.lcm", "x" * 300):
            self.assertIn(log, self.fail("--log", log))

    def test_a_full_disk(self):
        err = self.fail("--log", "/dev/full")
        self.assertIn("/dev/full", err)
        self.assertIn("No space left", err)
        self.assertIn("No space left", self.fail("--log", "/dev/full", "--realtime"))

    def test_a_folder_that_is_read_only(self):
        self.folder.write("faultline-logs", "in the way")
        self.assertIn("faultline-logs", self.fail())
        if os.geteuid() == 0:  # permissions do not bind root: run it as somebody else
            prefix = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
        else:
            prefix = []
        os.mkdir(self.folder.file("locked"))
        for file in os.listdir(EXAMPLE):
            if os.path.isfile(f"{EXAMPLE}/{file}"):
                shutil.copy(f"{EXAMPLE}/{file}", self.folder.file("locked"))
        copy = shutil.copy(program(), self.folder.file("faultline"))  # nobody may not be able to read the build tree
        os.chmod(copy, 0o755)
        os.chmod(self.folder.path, 0o755)
        os.chmod(self.folder.file("locked"), 0o555)
        try:
            process = subprocess.Popen([*prefix, copy, "run", "demo.toml"], cwd=self.folder.file("locked"),
                                       env={**self.folder.environment, "XDG_CACHE_HOME": "/proc/nosuch"},
                                       stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            answer = finish(process)
        finally:
            os.chmod(self.folder.file("locked"), 0o755)
        self.assert_code(3, answer)
        self.assertIn("faultline-logs", answer.err)
        self.assertIn("Permission denied", answer.err)

    def test_a_bad_lcm_url_leaves_the_old_log_alone(self):
        self.folder.write("own.lcm", OLD_LOG)
        answer = self.folder.run("run", "demo.toml", "--lcm", "nonsense://x", "--log", "own.lcm")
        self.assert_code(2, answer)
        self.assertIn("nonsense://x", answer.err)
        self.assertIn("udpm://", answer.err)
        self.assertEqual(self.folder.read("own.lcm"), OLD_LOG)

    def test_unwritable_data(self):
        for target in ("nosuch/run.json", "/dev/full"):
            self.assertIn(target, self.fail("--json", target))

    def test_a_full_stdout(self):
        with open("/dev/full", "w") as full:
            for arguments in (["run", "demo.toml", "--no-log"], ["run", "demo.toml", "--no-log", "--json", "-"],
                              ["info", "plant.toml"], ["design", "bank.toml"]):
                self.assert_code(3, self.folder.run(*arguments, stdout=full))

    def test_a_full_stderr_does_not_stop_a_run(self):
        with open("/dev/full", "w") as full:
            self.assert_code(0, self.folder.run("run", "demo.toml", stderr=full))

    def test_a_reader_that_leaves_early(self):
        for arguments in (["info", "plant.toml"], ["run", "demo.toml", "--json", "-"], ["design", "bank.toml"]):
            process = self.folder.start(*arguments)
            process.stdout.close()
            process.stdout = None
            self.assertIn(finish(process).code, (0, 3), arguments)

    def test_closed_standard_streams_do_not_end_up_in_the_log(self):
        def close_all():
            for stream in (0, 1, 2):
                os.close(stream)

        process = subprocess.Popen([program(), "run", "demo.toml", "--log", "own.lcm"], cwd=self.folder.path,
                                   env=self.folder.environment, preexec_fn=close_all)
        self.assertEqual(process.wait(30), 0)
        events, rest = read_log(self.folder.file("own.lcm"))
        self.assertEqual((events[-1].channel, rest), ("FAULTLINE_STATS", 0))


if __name__ == "__main__":
    unittest.main()
