#!/usr/bin/python3
"""The live page in Chromium, on a bench that runs on vcan.

The bench and `faultline dash` run inside tools/with-vcan. User Mode Linux has too little address space for V8, so
Chromium runs outside of it and reaches the dashboard through the standard streams of with-vcan (stream_tunnel.py): the
page, its script, its WebSocket and the bus are the real ones. DASH_PICTURES names a folder for screenshots.
"""
import os
import socket
import subprocess
import sys
import threading
import unittest

from chromium_page import ChromiumPage
from faultline_program import ROOT, FolderTest, finish, wait_for
from stream_tunnel import Tunnel, listen

PATIENCE_S = 100  # User Mode Linux has one CPU and expensive system calls
TOOLS = os.path.dirname(os.path.abspath(__file__))

# Clicks a button, and comes to the milliseconds until the verdict is so.
CLICK_UNTIL = """new Promise((done) => {
  const begin = performance.now(), verdict = document.getElementById("verdict");
  const watch = new MutationObserver(() => {
    if (verdict.textContent === %r) { watch.disconnect(); done(performance.now() - begin); }
  });
  watch.observe(verdict, { childList: true, characterData: true, subtree: true });
  document.querySelector("#quick button[data-target=%s]").click();
})"""
PRESSED = 'document.querySelector("#quick button[data-target=u2]").getAttribute("aria-pressed")'
# Whether something is drawn on each canvas, in more than one colour.
DRAWN = """[...document.querySelectorAll("#charts canvas")].map((canvas) => {
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data, colours = new Set();
  for (let i = 0; i < data.length; i += 4) if (data[i + 3] > 200) colours.add(`${data[i]} ${data[i + 1]} ${data[i + 2]}`);
  return colours.size;
})"""


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


class Guest:
    """What runs inside tools/with-vcan, and the way there."""

    def __init__(self, folder, scenario):
        self.port = free_port()
        self.told, self.has_told = [], threading.Event()
        self.log = open(folder.file("guest.txt"), "w+b")
        self.process = subprocess.Popen(
            [f"{ROOT}/tools/with-vcan", "--stdin", "-t", "200", "-i", "vcan0", "--", sys.executable, f"{TOOLS}/dash_guest.py",
             str(self.port), folder.file(scenario)],
            cwd=folder.path, env=folder.environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.log)
        self.tunnel = Tunnel(self.process.stdout.fileno(), self.process.stdin.fileno(), self.told.append)
        self.thread = threading.Thread(target=self.tunnel.run, daemon=True)
        self.thread.start()
        self.listener = listen(self.tunnel, self.port)

    def do(self, text):
        count = len(self.told)
        self.tunnel.send(0, text.encode())
        wait_for(lambda: len(self.told) > count, PATIENCE_S)

    def end(self):
        self.listener.close()
        self.process.stdin.close()
        self.process.wait(PATIENCE_S)
        self.thread.join(PATIENCE_S)
        self.process.stdout.close()
        self.log.close()


class DashPage(FolderTest):
    def setUp(self):
        super().setUp()
        text = self.folder.read("nodes.toml").decode()
        self.folder.write("healthy.toml", text[:text.index("[[fault]]")].replace("duration_s = 10.0",
                                                                                  "duration_s = 100000.0"))
        self.run_ok("design", "stable_bank.toml", "-o", "unused.json")  # not inside the guest, where it is slow
        self.guest = Guest(self.folder, "healthy.toml")
        self.addCleanup(self.guest.end)
        self.page = ChromiumPage("--window-size=1250,1000")
        self.addCleanup(self.page.close)

    def says(self, node, text):
        self.page.await_true(f'document.getElementById("{node}").textContent.includes("{text}")', PATIENCE_S)

    def picture(self, name, **options):
        if "DASH_PICTURES" in os.environ:
            self.page.screenshot(os.path.join(os.environ["DASH_PICTURES"], name), **options)

    def test_a_bench_seen_and_disturbed_from_a_browser(self):
        # Opened before the bench starts.
        self.guest.do("dash")
        self.page.go("about:blank")
        wait_for(self.is_served, PATIENCE_S, 0.2)
        self.page.go(f"http://127.0.0.1:{self.guest.port}/")
        self.says("connection", "waiting for the bench")
        self.guest.do("bench")
        self.says("verdict", "healthy")
        self.says("connection", "is running")
        self.page.await_true('document.getElementById("traffic").rows.length >= 5', PATIENCE_S)
        self.page.await_true(f"{DRAWN}.length >= 6 && {DRAWN}.every((colours) => colours > 1)", PATIENCE_S)
        self.page.await_true('document.querySelectorAll("#quick button").length === 4', PATIENCE_S)

        # One click: the fault is named on the page within a second.
        delay_ms = self.page.evaluate(CLICK_UNTIL % ("isolated u2", "u2"))
        self.assertLess(delay_ms, 1000.0)
        self.page.await_true(f'{PRESSED} === "true"', PATIENCE_S)
        self.assertEqual(self.page.evaluate('document.querySelectorAll("#lamps .fired").length'), 3)
        self.says("injected", "bias 1 on u2")
        self.says("answer", "u2")
        self.picture("dash.png", width=1250, height=900)
        self.picture("dash-dark.png", width=1250, height=900, prefers_color_scheme="dark")
        self.picture("dash-phone.png", width=390, height=1400, prefers_color_scheme="light")
        # The same button takes this fault away, and no other.
        self.page.evaluate('document.querySelector("#quick button[data-target=u3]").click()')
        self.says("verdict", "isolated u2+u3")
        self.page.evaluate('document.querySelector("#quick button[data-target=u2]").click()')
        self.says("verdict", "isolated u3")
        self.page.evaluate('document.getElementById("do-clear").click()')
        self.says("verdict", "healthy")
        # What the bench refuses is said on the page.
        self.page.evaluate('document.getElementById("target").value = "u22"; document.getElementById("do-inject").click()')
        self.says("answer", "did you mean")
        self.assertEqual(self.page.complaints, [])

        # The dashboard goes and comes back: the page connects again by itself.
        self.guest.do("end dash")
        self.says("connection", "connecting again")
        self.guest.do("dash")
        self.says("connection", "is running")
        # And the bench.
        self.guest.do("end bench")
        self.says("connection", "waiting for the bench")
        self.guest.do("bench")
        self.says("connection", "is running")

    def is_served(self):
        try:
            with socket.create_connection(("127.0.0.1", self.guest.port), 5) as one:
                one.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{self.guest.port}\r\n\r\n".encode())
                return one.recv(12).endswith(b"200")
        except OSError:
            return False


if __name__ == "__main__":
    unittest.main()
