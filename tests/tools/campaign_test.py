#!/usr/bin/python3
"""`faultline campaign` as a user meets it: a row per run whatever does the runs, resumed after any end, shards, MPI,
one run alone, and what is refused."""
import csv
import io
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import time
import unittest

from faultline_program import ROOT, Folder, FolderTest, finish, program, wait_for

RUNS = 600


class CampaignTest(FolderTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        # What the campaign comes to when nothing disturbs it.
        folder = Folder(cls.cache)
        try:
            cls.prepare(folder)
            answer = folder.run("campaign", "c/sweep.toml", "-o", "a.db", "-j", "1", "-q")
            assert answer.code == 0, answer
            cls.expected = rows(folder.file("a.db"))
        finally:
            folder.remove()

    @staticmethod
    def prepare(folder):
        shutil.copytree(f"{ROOT}/examples/hou2015/campaign", folder.file("c"))
        folder.patch("c/sweep.toml", ("runs     = 10000", f"runs     = {RUNS}"))
        folder.patch("c/single.toml", ("duration_s = 10.0", "duration_s = 4.0"))

    def setUp(self):
        super().setUp()
        self.prepare(self.folder)

    def campaign(self, *arguments, **options):
        return self.folder.run("campaign", "c/sweep.toml", "-q", *arguments, **options)

    def rows(self, name):
        return rows(self.folder.file(name))

    def assert_refused(self, text, *arguments):
        answer = self.campaign(*arguments)
        self.assert_code(2, answer)
        self.assertIn(text, answer.err)
        self.assertEqual(answer.out, "")


def rows(file):
    with sqlite3.connect(f"file:{file}?mode=ro", uri=True) as database:
        database.row_factory = sqlite3.Row
        found = [dict(row) for row in database.execute("SELECT * FROM run ORDER BY run")]
    database.close()
    return found


class Runs(CampaignTest):
    def test_rows_tell_what_happened(self):
        self.assertEqual([row["run"] for row in self.expected], list(range(RUNS)))
        self.assertEqual(len({row["seed"] for row in self.expected}), RUNS)
        for row in self.expected:
            point = json.loads(row["point"])
            self.assertIsNone(row["error"])
            cycles = row["faulty_cycles"] + row["faultless_cycles"] + row["inhibited_cycles"]
            self.assertEqual(cycles, 401)
            if point["fault"] is False:
                self.assertEqual((row["truth"], row["size"], row["onset_s"]), ("none", None, None))
                self.assertEqual(row["verdict"], "healthy")
                continue
            self.assertIn(row["truth"], ("u1", "u2", "u3", "u4"))
            self.assertAlmostEqual(row["size"], point["size"] * point["sign"], 12)
            self.assertTrue(2.0 <= row["onset_s"] < 3.01)
            # All residuals that see it fire from half a fault of size one on: the threshold.
            peak = max(json.loads(row["peak_faulty"]))
            self.assertEqual(row["detection_delay_s"] is not None, row["verdict"] != "healthy")
            if row["detection_delay_s"] is not None:
                self.assertGreater(peak, 1.0)
            if peak < 1.0:
                self.assertIsNone(row["detection_delay_s"])
            if abs(row["size"]) > 1.1:
                self.assertEqual(row["verdict"], f"isolated {row['truth']}")

    def test_a_run_alone_is_the_one_of_its_row(self):
        number = next(row["run"] for row in self.expected if row["isolation_delay_s"])
        answer = self.campaign("--run", str(number), "--log", "one.lcm", "--json", "one.json", "--report", "one.html")
        self.assert_code(0, answer)
        row = self.expected[number]
        outcome = json.loads(self.folder.read("one.json"))
        self.assertIn(row["truth"], json.dumps(outcome))
        injection = [item for item in outcome["injections"] if item["faults"] == [row["truth"]]][0]
        self.assertAlmostEqual(injection["isolation_delay_s"], row["isolation_delay_s"], 9)
        self.assertIn(b"<html", self.folder.read("one.html"))
        self.assert_code(0, self.folder.run("replay", "one.lcm"))

    def test_csv_is_the_table(self):
        answer = self.campaign("-o", "a.db", "--csv", "-")
        self.assert_code(0, answer)
        table = list(csv.DictReader(io.StringIO(answer.out)))
        self.assertEqual(len(table), RUNS)
        for line, row in zip(table, self.expected):
            self.assertEqual(list(line), list(row))
            for key, value in row.items():
                self.assertEqual(line[key], "" if value is None else value if isinstance(value, str) else line[key])
                if isinstance(value, float):
                    self.assertEqual(float(line[key]), value)

    def test_another_bank_meets_the_same_runs(self):
        self.assert_code(0, self.campaign("-o", "a.db", "--bank", "bank_200hz.toml"))
        for row, other in zip(self.expected, self.rows("a.db")):
            self.assertEqual((row["seed"], row["point"]), (other["seed"], other["point"]))


class SameWhoeverDoesThem(CampaignTest):
    def test_threads(self):
        self.assert_code(0, self.campaign("-o", "a.db", "-j", "3"))
        self.assertEqual(self.rows("a.db"), self.expected)

    def test_shards_put_together(self):
        for i in (1, 2, 3):
            self.assert_code(0, self.campaign("-o", f"s{i}.db", "--shard", f"{i}/3"))
        self.assertEqual([row["run"] % 3 for row in self.rows("s2.db")], [1] * (RUNS // 3))
        self.run_ok("campaign", "merge", "all.db", "s3.db", "s1.db", "s2.db", "s1.db")
        self.assertEqual(self.rows("all.db"), self.expected)
        self.assert_code(0, self.campaign("-o", "all.db"))  # nothing is missing
        answer = self.folder.run("campaign", "merge", "all.db", "s1.db")
        self.assert_code(2, answer)
        self.assertIn("nothing is overwritten", answer.err)

    def test_shards_that_disagree_are_not_put_together(self):
        for i in (1, 2):
            self.assert_code(0, self.campaign("-o", f"s{i}.db", "--shard", f"{i}/2"))
        shutil.copy(self.folder.file("s1.db"), self.folder.file("t.db"))
        with sqlite3.connect(self.folder.file("t.db")) as database:
            database.execute("UPDATE run SET false_alarms = 7 WHERE run = 4")
        database.close()
        answer = self.folder.run("campaign", "merge", "all.db", "s1.db", "t.db")
        self.assert_code(2, answer)
        self.assertIn("run 4: found another false_alarms", answer.err)
        self.assertFalse(os.path.exists(self.folder.file("all.db")))


class GoesOn(CampaignTest):
    def test_after_ten_kills(self):
        last = 0
        for _ in range(10):
            process = self.folder.start("campaign", "c/sweep.toml", "-q", "-o", "a.db", "-j", "1",
                                        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            wait_for(lambda: process.poll() is not None or self.count() > last)
            process.kill()
            process.wait()
            last = self.count()
        self.assert_code(0, self.campaign("-o", "a.db"))
        self.assertEqual(self.rows("a.db"), self.expected)

    def count(self):
        try:
            with sqlite3.connect(f"file:{self.folder.file('a.db')}?mode=ro", uri=True) as database:
                return database.execute("SELECT count(*) FROM run").fetchone()[0]
        except sqlite3.OperationalError:
            return 0  # not yet made
        finally:
            try:
                database.close()
            except UnboundLocalError:
                pass

    def test_after_an_interrupt(self):
        self.folder.patch("c/sweep.toml", (f"runs     = {RUNS}", "runs     = 100000"))
        process = self.folder.start("campaign", "c/sweep.toml", "-o", "a.db")
        wait_for(lambda: self.count() > 0)
        process.send_signal(signal.SIGINT)
        answer = finish(process)
        self.assert_code(130, answer)
        self.assertIn("goes on from here", answer.err)
        self.assertIn(f"{self.count()} of 100000 runs", answer.out)

    def test_where_the_disk_was_full(self):
        # A file system of 256 kB, in a namespace of its own.
        script = ("mount -t tmpfs -o size=256k none full && cd full && "
                  f"{program()} campaign ../c/sweep.toml -q -o a.db; code=$?; cp a.db ../a.db; exit $code")
        os.mkdir(self.folder.file("full"))
        answer = subprocess.run(["unshare", "-m", "sh", "-c", script], cwd=self.folder.path,
                                env=self.folder.environment, capture_output=True, text=True, check=False, timeout=60)
        self.assertEqual(answer.returncode, 3, answer)
        self.assertIn("disk is full", answer.stderr)
        self.assertLess(self.count(), RUNS)
        self.assert_code(0, self.campaign("-o", "a.db"))
        self.assertEqual(self.rows("a.db"), self.expected)

    def test_one_process_at_a_time_writes(self):
        self.folder.patch("c/sweep.toml", (f"runs     = {RUNS}", "runs     = 100000"))
        first = self.folder.start("campaign", "c/sweep.toml", "-q", "-o", "a.db")
        wait_for(lambda: self.count() > 0)
        second = self.campaign("-o", "a.db")
        first.send_signal(signal.SIGTERM)
        self.assert_code(143, finish(first))
        self.assert_code(3, second)
        self.assertIn("another campaign is writing it", second.err)


class Failures(CampaignTest):
    def test_a_run_that_fails_is_a_row_and_the_others_go_on(self):
        # Without a controller the plant is not stable.
        self.folder.patch("c/single.toml", ('kind = "lqr"', 'kind = "none"'), ("duration_s = 4.0", "duration_s = 800.0"))
        self.folder.patch("c/sweep.toml", (f"runs     = {RUNS}", "runs     = 3"))
        answer = self.campaign("-o", "a.db")
        self.assert_code(1, answer)
        self.assertIn("3 runs, the first is run 0: the plant diverged", answer.out)
        self.assertIn("--run 0", answer.out)
        for row in self.rows("a.db"):
            self.assertIn("the plant diverged", row["error"])
            self.assertIsNone(row["verdict"])

    def test_expectations_that_are_not_met_are_counted(self):
        with open(self.folder.file("c/single.toml"), "a") as file:
            file.write('\n[[expect]]\nfrom_s = 3.5\nuntil_s = 4.0\nverdict = "healthy"\n')
        answer = self.campaign("-o", "a.db")
        self.assert_code(1, answer)
        missed = [row["run"] for row in self.rows("a.db") if row["expectations_met"] == 0]
        self.assertGreater(len(missed), 100)
        self.assertIn(f"expectations of {len(missed)} runs, the first is run {missed[0]}", answer.out)


class Refusals(CampaignTest):
    def test_values_that_the_scenario_cannot_have(self):
        self.folder.patch("c/sweep.toml", ('target = "u4"', 'target = "u9"'))
        self.assert_refused('axis "fault" = ')
        self.folder.patch("c/sweep.toml", ('target = "u9"', 'target = "u4"'), ("fault[1].value\"\nfrom", "falt[1].value\"\nfrom"))
        self.assert_refused('did you mean "fault"')

    def test_a_sweep_of_a_million_million_runs(self):
        self.folder.patch("c/sweep.toml", (f"runs     = {RUNS}", "runs     = 1000000000000"))
        self.assert_refused("found 1000000000000 runs, about")
        self.assertFalse(os.path.exists(self.folder.file("sweep.db")))

    def test_other_databases(self):
        self.folder.write("junk.db", b"no database" * 100)
        self.assert_refused("junk.db: found no SQLite database", "-o", "junk.db")
        self.assertEqual(self.folder.read("junk.db"), b"no database" * 100)
        with sqlite3.connect(self.folder.file("other.db")) as database:
            database.execute("CREATE TABLE run (x)")
        database.close()
        self.assert_refused("other.db: found other tables", "-o", "other.db")
        self.assert_code(0, self.campaign("-o", "a.db", "--shard", "1/100"))
        before = self.folder.read("a.db")
        self.folder.patch("c/sweep.toml", ("seed     = 1", "seed     = 2"))
        self.assert_refused("a.db: found campaign \"hou2015\" with digest", "-o", "a.db")
        self.assertEqual(self.folder.read("a.db"), before)
        answer = self.folder.run("campaign", "merge", "m.db", "none.db")
        self.assert_code(2, answer)
        self.assertIn("none.db: found no file", answer.err)

    def test_arguments(self):
        self.assert_refused("--run: found 600, expected a run of c/sweep.toml: 0 to 599", "--run", "600")
        for shard in ("0/2", "3/2", "1", "1/0", "a/b", "1/2x", "-1/2"):
            self.assert_refused("--shard: found", "--shard=" + shard)
        answer = self.folder.run("campaign")
        self.assert_code(2, answer)
        self.assertIn("SWEEP: found none", answer.err)


class Ranks(CampaignTest):
    def test_ranks_of_mpi(self):
        for ranks in (2, 3):
            process = subprocess.Popen(
                [os.environ["MPIRUN"], "--allow-run-as-root", "--oversubscribe", "-n", str(ranks), program(),
                 "campaign", "c/sweep.toml", "-q", "-o", f"m{ranks}.db"],
                cwd=self.folder.path, env=self.folder.environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                stderr=subprocess.PIPE)
            self.assert_code(0, finish(process, 60))
            self.assertEqual(self.rows(f"m{ranks}.db"), self.expected)


if __name__ == "__main__":
    unittest.main()
