#!/usr/bin/python3
"""`faultline score` as a user meets it: what it says of a campaign agrees with the rows, and what is refused."""
import html.parser
import json
import shutil
import sqlite3
import statistics
import unittest

from faultline_program import ROOT, Folder, FolderTest

RUNS = 400


class Page(html.parser.HTMLParser):
    """Counts the elements of a page."""

    def __init__(self, text):
        super().__init__()
        self.counts, self.open = {}, []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.counts[tag] = self.counts.get(tag, 0) + 1


class ScoreTest(FolderTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.made = Folder(cls.cache)
        shutil.copytree(f"{ROOT}/examples/hou2015/campaign", cls.made.file("c"))
        cls.made.patch("c/sweep.toml", ("runs     = 10000", f"runs     = {RUNS}"))
        for bank, name in (("bank.toml", "a.db"), ("bank_200hz.toml", "b.db")):
            answer = cls.made.run("campaign", "c/sweep.toml", "-q", "-o", name, "--bank", bank)
            assert answer.code == 0, answer
        with sqlite3.connect(cls.made.file("a.db")) as database:
            database.row_factory = sqlite3.Row
            cls.rows = [dict(row) for row in database.execute("SELECT * FROM run")]
        database.close()

    @classmethod
    def tearDownClass(cls):
        cls.made.remove()
        super().tearDownClass()

    def score(self, *databases):
        answer = self.folder.run("score", *(self.made.file(name) for name in databases), "--json", "score.json", "-o",
                                 "score.html")
        self.assert_code(0, answer)
        return answer, json.loads(self.folder.read("score.json")), self.folder.read("score.html").decode()

    def test_numbers_are_those_of_the_rows(self):
        answer, (card,), page = self.score("a.db")
        total = {key: sum(row[key] or 0 for row in self.rows)
                 for key in ("faulty_cycles", "detected_cycles", "isolation_score", "faultless_cycles", "false_alarms")}
        self.assertAlmostEqual(card["TDR"]["value"], total["detected_cycles"] / total["faulty_cycles"], 12)
        self.assertAlmostEqual(card["FIA"]["value"], total["isolation_score"] / total["detected_cycles"], 12)
        self.assertAlmostEqual(card["missed_detection_rate"]["value"], 1.0 - card["TDR"]["value"], 12)
        self.assertEqual((card["false_alarms"], card["FAR"]["value"]), (0, 0.0))
        self.assertGreater(card["FAR"]["high"], 0.0)
        self.assertAlmostEqual(card["faultless_h"], total["faultless_cycles"] * 0.01 / 3600, 9)
        self.assertEqual(sum(sum(row.values()) for row in card["confusion"].values()), RUNS)
        for fault in card["faults"]:
            runs = [row for row in self.rows if (row["truth"], row["kind"]) == (fault["truth"], fault["kind"])]
            self.assertEqual(fault["runs"], len(runs))
            self.assertAlmostEqual(fault["detected"]["value"],
                                   sum(row["detected_cycles"] > 0 for row in runs) / len(runs), 12)
            self.assertLess(fault["detected"]["low"], fault["detected"]["value"])
            delays = sorted(row["detection_delay_s"] if row["detection_delay_s"] is not None else float("inf")
                            for row in runs)
            self.assertAlmostEqual(fault["detection_delay_median_s"]["value"], statistics.median_low(delays), 12)
            self.assertIsNone(fault["detection_delay_p95_s"]["value"])  # not so many are found
            # Half a fault of size one fires all that see it; of the larger gains a quarter is enough.
            size = fault["detectable_95"]["size"]
            self.assertAlmostEqual(fault["predicted"], 0.5, 9)
            self.assertTrue(any(abs(size["value"] - limit) < 0.05 for limit in (0.25, 0.5)), size)
            self.assertIn(f"{fault['truth']} bias", answer.out)
        self.assertEqual(Page(page).counts["svg"], 6)  # four faults, delays, ROC

    def test_two_banks_are_compared_run_by_run(self):
        _, (a, b), page = self.score("a.db", "b.db")
        self.assertEqual(a["runs"], b["runs"])
        self.assertNotEqual(a["digest"], b["digest"])
        self.assertIn(f"on the same {RUNS} runs", page)
        _, _, same = self.score("a.db", "a.db")
        self.assertIn("+0.0 points (+0.0 .. +0.0)", same)

    def test_the_page_needs_nothing_and_runs_nothing(self):
        _, _, page = self.score("a.db")
        counts = Page(page).counts
        self.assertNotIn("script", counts)
        self.assertEqual(counts["h1"], 1)
        self.assertEqual(counts["table"], counts["caption"])
        for outside in ("src=", "@import", "url("):
            self.assertNotIn(outside, page)

    def test_names_of_a_database_are_only_names(self):
        shutil.copy(self.made.file("a.db"), self.folder.file("x.db"))
        with sqlite3.connect(self.folder.file("x.db")) as database:
            database.execute("UPDATE run SET truth = '<img src=x onerror=alert(1)>' WHERE truth = 'u1'")
        database.close()
        self.assert_code(0, self.folder.run("score", "x.db", "-o", "x.html"))
        self.assertNotIn("img", Page(self.folder.read("x.html").decode()).counts)

    def test_a_campaign_that_is_not_finished(self):
        self.assert_code(0, self.made.run("campaign", "c/sweep.toml", "-q", "-o", self.folder.file("part.db"), "--shard",
                                          "1/4"))
        answer = self.run_ok("score", "part.db")
        self.assertIn(f"{RUNS // 4} of {RUNS} runs", answer.out)

    def test_what_is_no_campaign(self):
        self.folder.write("junk.db", b"junk" * 1000)
        with sqlite3.connect(self.folder.file("other.db")) as database:
            database.execute("CREATE TABLE run (x)")
        database.close()
        data = self.made.read("a.db")
        self.folder.write("cut.db", data[:len(data) // 2])
        for name, text in (("junk.db", "found no SQLite database"), ("other.db", "found other tables"),
                           ("none.db", "found no file")):
            answer = self.folder.run("score", name)
            self.assert_code(2, answer)
            self.assertIn(text, answer.err)
        answer = self.folder.run("score", "cut.db")
        self.assertIn(answer.code, (2, 3))
        self.assertIn("cut.db", answer.err)


if __name__ == "__main__":
    unittest.main()
