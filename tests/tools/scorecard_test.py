#!/usr/bin/python3
"""examples/scorecard.sh, with few runs: the page is there, and says of the banks what they are for."""
import json
import os
import subprocess
import unittest

from faultline_program import ROOT, FolderTest

BANKS = ("hou_geometric", "hou_geometric_cusum", "hou_ordinary", "ma_uio", "ma_ordinary", "jin_eigenstructure", "jin_ordinary")


class Scorecard(FolderTest):
    def test_the_methods_of_three_papers_on_one_page(self):
        page = self.folder.file("card.html")
        environment = dict(self.folder.environment, FAULTLINE=os.environ["FAULTLINE"])
        done = subprocess.run([f"{ROOT}/examples/scorecard.sh", page, "60"], env=environment, capture_output=True, timeout=200)
        self.assertEqual(done.returncode, 0, done.stderr.decode()[-2000:])
        text = self.folder.read("card.html").decode()
        for part in ("All banks", "hou2015, plant", "ma2024, plant", "jin, plant", *BANKS):
            self.assertIn(part, text)
        self.assertEqual(text.count("ROC of the bank"), 2 * 3)  # caption and label
        files = [f"scorecard-runs/{name}.db" for name in BANKS]
        cards = dict(zip(BANKS, json.loads(self.run_ok("score", *files, "--json", "-").out)))
        for card in cards.values():
            self.assertEqual(card["runs"], 60)
            self.assertEqual(card["failed"], 0)
        value = lambda bank, metric: cards[bank][metric]["value"]
        # An observer that ignores nothing isolates nothing; one that takes the friction for known gives false alarms.
        self.assertGreater(value("hou_geometric", "FIA"), value("hou_ordinary", "FIA"))
        self.assertGreater(value("hou_geometric_cusum", "TDR"), value("hou_geometric", "TDR"))
        self.assertGreater(value("ma_uio", "FIA"), value("ma_ordinary", "FIA"))
        self.assertGreater(value("jin_ordinary", "FAR"), 0.5)
        self.assertLess(value("jin_eigenstructure", "FAR"), 0.01)
        self.assertLess(value("hou_geometric", "FAR"), 0.01)
        # Faults that look alike have no size from which the design would promise to tell them apart.
        self.assertTrue(all(fault["predicted"] for fault in cards["hou_geometric"]["faults"]))
        self.assertFalse(any(fault["predicted"] for fault in cards["hou_ordinary"]["faults"]))


if __name__ == "__main__":
    unittest.main()
