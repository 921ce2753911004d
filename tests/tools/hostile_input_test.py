#!/usr/bin/python3
"""Random damage to every kind of file."""
import concurrent.futures
import random
import re
import signal
import subprocess
import unittest

from faultline_program import Folder, FolderTest, without_comments

STOP_WITHIN_S = 2.0


class HostileInput(FolderTest):
    """Random damage to each kind of file: an answer, never a crash, never a hang."""

    COUNT = 300
    HANG_S = 10.0
    NUMBERS = ["0", "-1", "1e30", "-1e30", "1e300", "1e-300", "1e999", "nan", "inf", "-inf", "9223372036854775807",
               "18446744073709551616", "4294967296", "2147483648", "-2147483649", "0.1", "3", "1e5", "NaN", "0x7f"]

    @staticmethod
    def mutate(text, seed):
        """One to four random changes of `text`, a function of `seed`."""
        chance = random.Random(seed)
        data = bytearray(text)
        for _ in range(chance.randint(1, 4)):
            lines = bytes(data).splitlines(keepends=True) or [b"\n"]
            at, line = chance.randrange(len(data) + 1), chance.randrange(len(lines))
            kind = chance.randrange(8)
            if kind == 0 and at < len(data):  # one bit
                data[at] ^= 1 << chance.randrange(8)
            elif kind == 1:  # one byte
                data[at:at + 1] = bytes([chance.randrange(256)])
            elif kind == 2:  # a stretch is lost
                del data[at:at + chance.randint(1, 20)]
            elif kind == 3:  # a line is lost
                data = bytearray(b"".join(lines[:line] + lines[line + 1:]))
            elif kind == 4:  # a line twice, or elsewhere
                data = bytearray(b"".join(lines[:line] + [lines[chance.randrange(len(lines))]] + lines[line:]))
            elif kind == 5:  # the end is lost
                del data[at:]
            else:  # a number is another
                found = list(re.finditer(rb"-?\d+(\.\d+)?", bytes(data)))
                if found:
                    number = chance.choice(found)
                    data[number.start():number.end()] = chance.choice(HostileInput.NUMBERS).encode()
        return bytes(data)

    def try_one(self, folder, file, seed, *arguments):
        original = folder.read(file)
        folder.write(file, self.mutate(original, seed))
        try:
            process = folder.start(*arguments)
            try:
                code = finish_quietly(process, self.HANG_S)
            except subprocess.TimeoutExpired:
                # A run may have become a long one; then it can be stopped, and a hang cannot.
                process.send_signal(signal.SIGINT)
                code = finish_quietly(process, STOP_WITHIN_S)
                code = 0 if code == 130 else "hangs"
            return [] if code in (0, 1, 2) else [f"{file}, seed {seed}: {code}"]
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return [f"{file}, seed {seed}: hangs"]
        finally:
            folder.write(file, original)

    def attack(self, file, *arguments):
        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            folders = [self.prepare() for _ in range(2)]

            def work(i):
                return [fault for seed in range(i, self.COUNT, len(folders))
                        for fault in self.try_one(folders[i], file, seed, *arguments)]

            faults = [fault for found in pool.map(work, range(len(folders))) for fault in found]
        self.assertEqual(faults, [], "of exit codes 0, 1 and 2")

    def prepare(self):
        folder = Folder()
        self.addCleanup(folder.remove)
        # Short runs: what is under test is how the files are read.
        text = re.sub(r"duration_s = \S+", "duration_s = 0.2", folder.read("demo.toml").decode())
        text = re.sub(r"at_s   = \S+", "at_s   = 0.1", text)
        text = re.sub(r"from_s  = \S+", "from_s  = 0.1", re.sub(r"until_s = \S+", "until_s = 0.2", text))
        folder.write("s.toml", without_comments(text))
        assert folder.run("design", "bank.toml", "-o", "b.bank.json").code == 0
        folder.write("b.toml", folder.read("s.toml").replace(b'"bank.toml"', b'"b.bank.json"'))
        return folder

    def test_plant(self):
        self.attack("plant.toml", "run", "s.toml", "--no-log")

    def test_bank_request(self):
        self.attack("bank.toml", "run", "s.toml", "--no-log")

    def test_scenario(self):
        self.attack("s.toml", "run", "s.toml", "--no-log")

    def test_dbc(self):
        self.attack("bench.dbc", "run", "s.toml", "--no-log")

    def test_bank_file(self):
        self.attack("b.bank.json", "run", "b.toml", "--no-log")

    def test_a_plant_that_is_scaled_badly(self):
        self.folder.patch("plant.toml", ("[2, 0, -4]]", "[2, 0, 54]]"), ("C = [[0, 1, 0]", "C = [[2147483648, 1, 0]"))
        self.assertIn(self.folder.run("design", "bank.toml", patience_s=self.HANG_S).code, (0, 1, 2))

    def test_log(self):
        self.run_ok("run", "demo.toml", "--log", "own.lcm")
        log = self.folder.read("own.lcm")[:40_000]
        for seed in range(100):
            self.folder.write("own.lcm", log)
            self.assertEqual(self.try_one(self.folder, "own.lcm", seed, "info", "own.lcm", "--json", "-"), [])


def finish_quietly(process, patience_s):
    process.communicate(timeout=patience_s)
    return process.returncode


if __name__ == "__main__":
    unittest.main()
