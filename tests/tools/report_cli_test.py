#!/usr/bin/python3
"""`faultline report`: what is in the page, and that headless Chromium shows it without an error.

The page is taken apart here by code that shares nothing with the program.
"""
import base64
import html.parser
import json
import os
import re
import shutil
import struct
import subprocess
import tempfile
import time
import unittest

from faultline_program import ROOT, Folder, FolderTest, decode, read_log

TRUTH, RUN = "FAULTLINE_TRUTH", "FAULTLINE_RUN"
CHROMIUM_S = 90  # takes 3 s on a quiet machine


class Page(html.parser.HTMLParser):
    """Text, tags, scripts and data of a page; raises nothing, counts what does not nest."""
    VOID = {"meta", "link", "input", "br"}

    def __init__(self, text):
        super().__init__()
        self.text, self.tags, self.scripts, self.open, self.misnested = "", [], [], [], []
        self.feed(text)
        self.data = json.loads(self.scripts[0])

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag not in self.VOID:
            self.open.append(tag)
        if tag == "script":
            self.scripts.append("")

    def handle_startendtag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.misnested.append(tag)

    def handle_data(self, data):
        if self.open and self.open[-1] == "script":
            self.scripts[-1] += data
        elif self.open and self.open[-1] != "style":
            self.text += data

    def all(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]


def floats(text):
    data = base64.b64decode(text, validate=True)
    return struct.unpack(f"<{len(data) // 4}f", data)


def write_log(file, events):
    with open(file, "wb") as out:
        for event in events:
            out.write(b"\xED\xA1\xDA\x01" + struct.pack(">qqii", event.number, event.utime, len(event.channel),
                                                        len(event.data)) + event.channel.encode() + event.data)


class Report(FolderTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.made = Folder(cls.cache)
        for name in ("demo", "fig15"):
            answer = cls.made.run("run", f"{name}.toml", "--log", f"{name}.lcm", "--report", f"{name}.html",
                                  "--json", f"{name}.json", "--quiet")
            assert answer.code == 0, answer
        cls.page = Page(cls.made.read("demo.html").decode())
        cls.events = read_log(cls.made.file("demo.lcm"))[0]

    @classmethod
    def tearDownClass(cls):
        cls.made.remove()
        super().tearDownClass()

    def report(self, *logs):
        self.run_ok("report", *logs, "-o", "out.html")
        return Page(self.folder.read("out.html").decode())

    # ------------------------------------------------------------------------------ what is in it

    def test_it_stands_alone_and_nests(self):
        self.assertEqual(self.page.misnested, [])
        self.assertEqual(self.page.open, [])
        for tag, attributes in self.page.tags:
            for name in ("src", "href", "action"):
                self.assertRegex(attributes.get(name) or "#", r"^(#|data:)", f"{tag} refers to another file")
        self.assertNotIn("sourceMappingURL", "".join(self.page.scripts))

    def test_it_can_be_read_without_seeing_it(self):
        tags = [tag for tag, _ in self.page.tags]
        for landmark in ("main", "nav", "header"):
            self.assertEqual(tags.count(landmark), 1, landmark)
        self.assertEqual(tags.count("table"), tags.count("caption"))
        for attributes in self.page.all("svg") + [a for a in self.page.all("div") if a.get("class") == "chart"]:
            self.assertEqual(attributes.get("role"), "img")
            self.assertGreater(len(attributes.get("aria-label", "")), 20)
        ids = {attributes["id"] for _, attributes in self.page.tags if "id" in attributes}
        for attributes in self.page.all("a"):
            self.assertIn(attributes["href"][1:], ids)

    def test_the_charts_hold_the_logs_residuals(self):
        logged = [decode(event) for event in self.events if event.channel == "FAULTLINE_RESIDUAL"]
        charts = {chart["title"]: chart for chart in self.page.data["charts"]}
        for index, name in enumerate(("r12", "r13", "r14", "r23", "r24", "r34")):
            line = charts[name]["series"][0]
            values = [message["residual"][index] for message in logged]
            if line["kind"] == "envelope":
                shown = floats(line["high"])
                self.assertEqual(len(shown), len(values))
                self.assertAlmostEqual(line["bucket_s"], 0.01)
                for ours, logs in zip(shown, values):
                    self.assertAlmostEqual(ours, logs, delta=1e-6 * max(abs(logs), 1e-30) + 1e-12)
            fired = [message["fired"][index] for message in logged]
            first = next((message["cycle"] for message, now in zip(logged, fired) if now), None)
            shown = charts[name]["fired"][0]
            self.assertEqual(bool(shown), first is not None)
            if shown:
                self.assertAlmostEqual(shown[0][0], 0.01 * first)

    def test_delays_are_those_of_the_run(self):
        summary = json.loads(self.made.read("fig15.json"))
        page = Page(self.made.read("fig15.html").decode())
        # fig15: u1 from 50 s, isolated at 50.2 s; u3 as well from 70 s, isolated at 70.07 s.
        verdicts = {entry["verdict"] + " " + " ".join(entry["faults"]): entry["t_s"]
                    for entry in summary["verdicts"]}
        delay = verdicts["isolated u1 u3"] - 70.0
        self.assertIn(f"{delay:.4g} s", page.text)
        self.assertIn(f"{verdicts['isolated u1'] - 50.0:.4g} s", page.text)
        for name in ("TDR", "FAR", "FIA", "Missed-detection rate", "Isolation confusion", "Delays"):
            self.assertIn(name, page.text)

    def test_the_certificate_is_told_in_words(self):
        self.assertRegex(self.page.text, r"r23 ignores u2 and u3: leakage \de-\d+")
        self.assertRegex(self.page.text, r"Repeat it with faultline run .*demo\.toml \(seed 1\)")

    def test_two_runs_are_laid_over_each_other(self):
        page = self.report(self.made.file("demo.lcm"), self.made.file("fig15.lcm"))
        chart = next(chart for chart in page.data["charts"] if chart["title"] == "r12")
        self.assertEqual({series["run"] for series in chart["series"]}, {0, 1})
        self.assertIn("run A", page.text)
        self.assertIn("Run B", page.text)
        self.assertEqual(page.misnested, [])

    def test_the_files_of_a_split_log_are_one_run(self):
        self.run_ok("run", "demo.toml", "--log", "s.lcm", "--log-split-time", "3", "--report", "s.html", "--quiet")
        page = Page(self.folder.read("s.html").decode())
        self.assertIn("1001 cycles", page.text)
        files = [f"s-{number:04}.lcm" for number in (1, 2, 3, 4)]
        self.assertEqual(self.report("--split", *files).data, page.data)
        self.assert_code(2, self.folder.run("run", "demo.toml", "--no-log", "--report", "s.html"))

    # ------------------------------------------------------------------------------ bad input

    def test_a_real_unit_has_no_truth(self):
        write_log(self.folder.file("real.lcm"), [e for e in self.events if e.channel != TRUTH])
        page = self.report("real.lcm")
        self.assertIn("has no TRUTH", page.text)
        self.assertNotIn("Isolation confusion", page.text)
        self.assertIn("isolated u2, u3", page.text)

    def test_without_run_names_are_by_position(self):
        write_log(self.folder.file("no_run.lcm"), [e for e in self.events if e.channel != RUN])
        page = self.report("no_run.lcm")
        self.assertIn("has no RUN", page.text)
        self.assertIn("r6", [chart["title"] for chart in page.data["charts"]])
        self.assertIn("1001 cycles of 0.01 s, measured", page.text)

    def test_a_log_that_is_cut_anywhere_gives_a_page(self):
        log = self.made.read("demo.lcm")
        for share in (0.05, 0.3, 0.7, 0.999):
            self.folder.write("cut.lcm", log[:int(share * len(log))])
            self.assertIn("ends before", self.report("cut.lcm").text)

    def test_what_is_no_log_is_refused(self):
        self.folder.write("empty.lcm", b"")
        self.folder.write("text.lcm", b"no log at all\n" * 100)
        write_log(self.folder.file("other.lcm"), [self.events[0]._replace(channel="OTHER")])
        for name in ("empty.lcm", "text.lcm", "other.lcm"):
            answer = self.folder.run("report", name, "-o", "out.html")
            self.assert_code(2, answer)
            self.assertIn(name, answer.err)
            self.assertFalse(os.path.exists(self.folder.file("out.html")))
        self.assert_code(2, self.folder.run("report", "a.lcm", "b.lcm", "c.lcm"))
        answer = self.folder.run("report", self.made.file("demo.lcm"), "-o", "no/folder/out.html")
        self.assert_code(3, answer)

    def test_any_byte_may_be_wrong(self):
        log = bytearray(self.made.read("demo.lcm"))
        for at in range(1000, len(log), len(log) // 300):
            log[at] ^= 0x55
        self.folder.write("broken.lcm", bytes(log))
        page = self.report("broken.lcm")
        self.assertEqual(page.misnested, [])

    def hostile(self):
        """A log whose names try to be script."""
        name = "</script><script>document.title='HACKED'</script><img src=x onerror=\"document.title='HACKED'\">"
        self.folder.patch("demo.toml", ('name   = "demo"', f"name   = '''{name}'''"))
        self.run_ok("run", "demo.toml", "--log", "hostile.lcm", "--report", "hostile.html", "--quiet")
        return self.folder.file("hostile.html")

    def test_names_are_no_script(self):
        with open(self.hostile(), encoding="utf-8") as file:
            page = Page(file.read())
        self.assertEqual(len(page.all("script")), 3)
        self.assertEqual(page.all("img"), [])
        self.assertIn("HACKED", page.text)  # it is shown

    # ------------------------------------------------------------------------------ Chromium

    def chromium(self, *arguments):
        profile = tempfile.mkdtemp(prefix="faultline-chromium.")
        try:
            environment = {**os.environ, "HOME": profile, "XDG_CONFIG_HOME": profile, "XDG_CACHE_HOME": profile}
            return subprocess.run(
                ["chromium", "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
                 "--disable-dev-shm-usage", f"--user-data-dir={profile}", "--enable-logging=stderr", *arguments],
                capture_output=True, env=environment, timeout=CHROMIUM_S, check=True)
        finally:
            shutil.rmtree(profile, ignore_errors=True)

    def dom(self, file):
        answer = self.chromium("--virtual-time-budget=10000", "--window-size=1250,6000", "--dump-dom", f"file://{file}")
        errors = [line for line in answer.stderr.decode(errors="replace").splitlines() if "CONSOLE" in line]
        self.assertEqual(errors, [])
        return answer.stdout.decode()

    def test_it_renders_with_no_console_error(self):
        dom = self.dom(self.made.file("demo.html"))
        self.assertGreaterEqual(dom.count("<canvas"), 2 * len(self.page.data["charts"]))
        self.assertIn("dygraph-axis-label", dom)

    def test_the_comparison_renders(self):
        self.report(self.made.file("demo.lcm"), self.made.file("fig15.lcm"))
        self.assertGreater(self.dom(self.folder.file("out.html")).count("<canvas"), 2 * 13)

    def test_a_hostile_name_runs_nothing(self):
        dom = self.dom(self.hostile())
        title = re.search(r"<title>(.*?)</title>", dom, re.DOTALL).group(1)
        self.assertNotEqual(title, "HACKED")
        self.assertIn("&lt;script&gt;", title)

    def test_zooming_in_shows_every_sample(self):
        # A script of the test's own, let in by the page's number: it reports through the title.
        text = self.made.read("fig15.html").decode()
        nonce = re.search(r"nonce-([0-9a-f-]+)", text).group(1)
        probe = ("faultlineReport.makeAll(); faultlineReport.show(50, 50.5);"
                 "const seen = faultlineReport.charts.map((c) => [c.chart.title,"
                 " c.dygraph.xAxisRange(), c.dygraph.file_.filter((row) => row[0] >= 50 && row[0] < 50.5"
                 " && row[1] !== null).length, c.dygraph.numRows()]); document.title = JSON.stringify(seen);")
        self.folder.write("probe.html", text.replace("</body>", f'<script nonce="{nonce}">{probe}</script></body>'))
        title = re.search(r"<title>(.*?)</title>", self.dom(self.folder.file("probe.html")), re.DOTALL).group(1)
        for name, window, count, rows in json.loads(title.replace("&amp;", "&")):
            self.assertAlmostEqual(window[0], 50.0)
            self.assertAlmostEqual(window[1], 50.5)
            if name in ("y1", "y2", "y3"):
                self.assertGreaterEqual(count, 50, name)
                self.assertLess(rows, 1000, "what is out of sight is drawn coarsely")

    def test_it_is_printed(self):
        pdf = self.folder.file("page.pdf")
        self.chromium("--virtual-time-budget=10000", f"--print-to-pdf={pdf}", f"file://{self.made.file('demo.html')}")
        with open(pdf, "rb") as file:
            content = file.read()
        self.assertTrue(content.startswith(b"%PDF"))
        self.assertGreater(len(re.findall(rb"/Type\s*/Page\b", content)), 2)

    def test_papers_figures(self):
        for example, count in (("hou2015", 14), ("ma2024", 5)):
            out = self.folder.file(f"{example}.html")
            subprocess.run([f"{ROOT}/examples/{example}/figures.sh", out], check=True, capture_output=True,
                           env=self.folder.environment, timeout=120)
            with open(out, encoding="utf-8") as file:
                page = Page(file.read())
            self.assertEqual(page.text.count("The paper says"), count)
            self.assertEqual(page.misnested, [])
            self.assertEqual(len(page.data["charts"]), 84 if example == "hou2015" else page.text.count("Largest value"))
            self.assertIn("<canvas", self.dom(out))

    def test_a_figures_file_is_read_strictly(self):
        self.folder.write("figures.toml", 'title = "t"\nintroduction = "i"\n[[figure]]\ntitle = "f"\nlog = "x.lcm"\n'
                                          'claim = "c"\ntruht = "t"\n')
        answer = self.folder.run("report", ".", "--figures", "figures.toml", "-o", "out.html")
        self.assert_code(2, answer)
        self.assertIn("figures.toml:3", answer.err)

    # ------------------------------------------------------------------------------ an hour

    def test_an_hour_at_100_hz(self):
        text = self.folder.read("fig15.toml").decode().split("[[expect]]")[0]
        self.folder.write("hour.toml", text.replace("duration_s = 100.0", "duration_s = 3600.0"))
        self.run_ok("run", "hour.toml", "--log", "hour.lcm", "--quiet", patience_s=120)
        begin = time.monotonic()
        page = self.report("hour.lcm")
        self.assertLess(time.monotonic() - begin, 15)  # 1 s on a quiet machine; parsing is the test's own
        self.assertLess(os.path.getsize(self.folder.file("out.html")), 5e6)
        self.assertIn("360001 cycles", page.text)


if __name__ == "__main__":
    unittest.main()
