#!/usr/bin/python3
"""`faultline watch`: the essentials of a running bench in a terminal, which is left as it was found.

In a network namespace of its own.
"""
import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import termios
import time
import unittest

from faultline_program import FolderTest, finish, wait_for
from inject_test import send_raw
from multicast_namespace import URL, enter_namespace

BUS = "udp:239.74.163.2:43113"


class Terminal:
    """A program on a terminal of its own."""

    def __init__(self, arguments, columns, rows):
        self.end, slave = pty.openpty()
        self.resize(columns, rows)
        self.process = subprocess.Popen(arguments, stdin=slave, stdout=slave, stderr=slave, start_new_session=True)
        os.close(slave)
        self.output = b""

    def resize(self, columns, rows):
        fcntl.ioctl(self.end, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def read(self, time_s):
        """What it wrote within `time_s`."""
        begin, end = len(self.output), time.monotonic() + time_s
        while time.monotonic() < end:
            if select.select([self.end], [], [], 0.05)[0]:
                try:
                    self.output += os.read(self.end, 65536)
                except OSError:  # it has ended
                    break
        return self.output[begin:]

    def picture(self):
        """The lines of the newest whole picture, without escape sequences."""
        text = self.read(0.5)
        whole = text.split(b"\x1b[H")[1:-1]
        return [re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", line) for line in whole[-1].decode().replace("\r\r\n", "\r\n").split("\r\n")]

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        os.close(self.end)


class Watch(FolderTest):
    def setUp(self):
        super().setUp()
        text = self.folder.read("nodes.toml").decode()
        self.folder.write("healthy.toml", text[:text.index("[[fault]]")].replace("duration_s = 10.0",
                                                                                  "duration_s = 100000.0"))

    def start_run(self):
        process = self.folder.start("run", "healthy.toml", "--lcm", URL, "--realtime", "--bus", BUS)
        self.addCleanup(lambda: process.poll() is None and (process.kill(), process.communicate()))
        wait_for(lambda: process.poll() is not None
                 or self.folder.run("inject", "--clear", "--wait", "0.5", "--lcm", URL).code == 0)
        return process

    def stop(self, process):
        process.send_signal(signal.SIGINT)
        return finish(process)

    def test_lines_without_a_terminal(self):
        out = open(self.folder.file("lines.txt"), "w+b")
        self.addCleanup(out.close)
        watch = self.folder.start("watch", "--lcm", URL, stdout=out)
        self.addCleanup(lambda: watch.poll() is None and (watch.kill(), watch.communicate()))
        wait_for(lambda: b"waiting for the bench" in self.folder.read("lines.txt"))
        run = self.start_run()
        wait_for(lambda: b"\nhealthy " in self.folder.read("lines.txt"))
        self.run_ok("inject", "u2", "bias", "2", "--lcm", URL)
        wait_for(lambda: b"\nisolated u2 " in self.folder.read("lines.txt"))
        # What is no message of ours does not hurt.
        send_raw(b"", os.urandom(100), b"\xff" * 60000)
        self.run_ok("inject", "--clear", "u2", "--lcm", URL)
        wait_for(lambda: b"\nhealthy " in self.folder.read("lines.txt").split(b"\nisolated u2 ")[-1])
        self.stop(run)
        wait_for(lambda: self.folder.read("lines.txt").splitlines()[-1].startswith(b"waiting for the bench"))
        self.assertEqual(self.stop(watch).code, 128 + signal.SIGINT)
        self.assertNotIn(b"\x1b", self.folder.read("lines.txt"))

    def test_a_terminal_of_any_size(self):
        self.start_run()
        terminal = Terminal([os.environ["FAULTLINE"], "watch", "--lcm", URL], 100, 30)
        self.addCleanup(terminal.close)
        terminal.read(6.5)  # RUN, with the residuals' names, comes every 5 s
        lines = terminal.picture()
        self.assertTrue(lines[0].startswith("healthy "), lines)
        self.assertEqual([line.split()[0] for line in lines[2:8]], ["r12", "r13", "r14", "r23", "r24", "r34"])
        for columns, rows in ((40, 30), (100, 5), (10, 3), (1, 1), (200, 60)):
            terminal.resize(columns, rows)
            terminal.read(0.3)
            lines = terminal.picture()
            self.assertLessEqual(len(lines), rows)
            self.assertLessEqual(max(len(line) for line in lines), columns)
        terminal.process.send_signal(signal.SIGINT)
        self.assertEqual(terminal.process.wait(10), 128 + signal.SIGINT)
        terminal.read(0.2)
        self.assertTrue(terminal.output.startswith(b"\x1b[?1049h\x1b[?25l"))
        self.assertTrue(terminal.output.endswith(b"\x1b[?25h\x1b[?1049l"))

    def test_a_url_that_is_none(self):
        for url in ("nonsense", "file://log.lcm", "udpm://1.2.3.4:99999"):
            answer = self.folder.run("watch", "--lcm", url)
            self.assert_code(2, answer)
            self.assertIn(url, answer.err)


if __name__ == "__main__":
    enter_namespace(__file__)
    unittest.main()
