#!/usr/bin/python3
"""`faultline dash` as a browser meets it: who is let in, what a viewer may say, what it is told.

In a network namespace of its own.
"""
import json
import os
import random
import signal
import socket
import time
import unittest

from faultline_program import FolderTest, finish, wait_for
from inject_test import send_raw
from multicast_namespace import URL, enter_namespace
from web_socket import PATIENCE_S, WebSocket, status, upgrade

BUS = "udp:239.74.163.2:43113"


class Viewer(WebSocket):
    """A viewer of the live page."""

    def __init__(self, port, path="/live"):
        super().__init__(port, path)

    def until(self, condition):
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            message = self.receive()
            if condition(message):
                return message
        raise AssertionError("it did not come")

    def reply(self, payload):
        self.send(payload)
        return self.until(lambda message: message["type"] in ("sent", "refused"))


class Dash(FolderTest):
    def setUp(self):
        super().setUp()
        text = self.folder.read("nodes.toml").decode()
        self.folder.write("healthy.toml", text[:text.index("[[fault]]")].replace("duration_s = 10.0",
                                                                                  "duration_s = 100000.0"))

    def start(self, *arguments, out="dash.txt"):
        file = open(self.folder.file(out), "w+b")
        self.addCleanup(file.close)
        process = self.folder.start(*arguments, "--lcm", URL, stdout=file)
        self.addCleanup(lambda: process.poll() is None and (process.kill(), process.communicate()))
        return process

    def start_dash(self, *arguments):
        process = self.start("dash", "--listen", "127.0.0.1:0", *arguments)
        wait_for(lambda: b"http://" in self.folder.read("dash.txt"))
        return process, int(self.folder.read("dash.txt").split(b":")[2].split(b"/")[0])

    def viewer(self, port, *path):
        viewer = Viewer(port, *path)
        self.addCleanup(viewer.close)
        return viewer

    def test_a_fault_from_the_page_is_named_within_a_second(self):
        dash, port = self.start_dash()
        viewer = self.viewer(port)
        self.assertFalse(viewer.until(lambda message: message["type"] == "state")["running"])
        self.start("run", "healthy.toml", "--realtime", "--bus", BUS, out="run.txt")
        viewer.until(lambda message: message.get("kind") == "healthy")
        begin = time.monotonic()
        self.assertEqual(viewer.reply(b'{"type": "inject", "target": "u2", "kind": "bias", "value": 2}')["type"], "sent")
        state = viewer.until(lambda message: message.get("verdict") == "isolated u2")
        self.assertLess(time.monotonic() - begin, 1.0)
        self.assertEqual(sum(state["fired"]), 3)
        self.assertTrue(any(event["source"] == "inject" for event in state["events"]))
        self.assertEqual(viewer.reply(b'{"type": "clear"}')["type"], "sent")
        viewer.until(lambda message: message.get("kind") == "healthy")
        # What the bench refuses is told, too.
        request = viewer.reply(b'{"type": "inject", "target": "u22", "kind": "bias", "value": 2}')["request"]
        viewer.until(lambda message: any(event["text"].startswith(request + ":") and "did you mean" in event["text"]
                                         for event in message.get("events", [])))
        dash.send_signal(signal.SIGINT)
        self.assertEqual(finish(dash).code, 128 + signal.SIGINT)

    def test_who_is_let_in(self):
        _, port = self.start_dash("--token", "sesame")
        own = f"http://127.0.0.1:{port}"
        for path, code in (("/", 401), ("/?token=", 401), ("/?token=sesam", 401), ("/?token=sesame1", 401),
                           ("/?token=sesame", 200), ("/nothing", 404), ("/../etc/passwd", 404)):
            self.assertEqual(status(port, path), code, path)
        self.assertEqual(status(port, "/?token=sesame", host=f"evil.example:{port}"), 403)
        self.assertEqual(status(port, "/?token=sesame", host=f"localhost:{port}"), 200)
        self.assertEqual(status(port, "/?token=sesame", host=f"127.0.0.1:{port ^ 1}"), 403)
        for path, origin, code in (("/live", own, 401), ("/live?token=wrong", own, 401),
                                   ("/live?token=sesame", "http://evil.example", 403),
                                   ("/live?token=sesame", "null", 403), ("/live?token=sesame", None, 403),
                                   ("/other?token=sesame", own, 404), ("/live?token=sesame", own, 101)):
            self.assertEqual(status(port, path, headers=upgrade(origin)), code, (path, origin))

    def test_bad_arguments(self):
        for listen in ("nonsense", "127.0.0.1", "127.0.0.1:x", "127.0.0.1:99999", "example.com:80", ":80", "[::1:80"):
            answer = self.folder.run("dash", "--lcm", URL, "--listen", listen)
            self.assert_code(2, answer)
            self.assertIn("expected ADDRESS:PORT", answer.err)
        answer = self.folder.run("dash", "--lcm", URL, "--listen", "0.0.0.0:0")
        self.assert_code(2, answer)
        self.assertIn("--token", answer.err)
        self.assert_code(2, self.folder.run("dash", "--lcm", "nonsense"))
        with socket.socket() as other:
            other.bind(("127.0.0.1", 0))
            other.listen()
            answer = self.folder.run("dash", "--lcm", URL, "--listen", f"127.0.0.1:{other.getsockname()[1]}")
        self.assert_code(3, answer)
        self.assertIn("cannot listen on 127.0.0.1:", answer.err)

    def test_hostile_messages(self):
        dash, port = self.start_dash()
        viewer = self.viewer(port)
        for payload in (b"", b"{", b"[" * 4000, b"null", b"[]", b'{"type": 1}', b'{"type": "run"}', b'{"type": "inject"}',
                        b'{"type": "inject", "target": "u2", "kind": "bias", "value": 1e999}',
                        b'{"type": "inject", "target": "u2", "kind": "bias", "value": "2"}',
                        b'{"type": "inject", "target": "u\\u0000", "kind": "bias"}',
                        b'{"type": "clear", "other": 1}', b'{"type": "clear", "target": []}'):
            answer = viewer.reply(payload)
            self.assertEqual(answer["type"], "refused", payload)
            self.assertIn("expected" if payload != b'{"type": "clear", "other": 1}' else "none of", answer["text"])
        seed = 20261123
        draw = random.Random(seed)
        model = b'{"type": "inject", "target": "u2", "kind": "bias", "value": 2.5}'
        for _ in range(60):
            text = bytearray(model)
            for _ in range(draw.randrange(1, 6)):
                text[draw.randrange(len(text))] = draw.randrange(0x20, 0x7f)
            self.assertIn(viewer.reply(bytes(text))["type"], ("sent", "refused"), f"seed {seed}: {text}")
        # Not UTF-8, too long, no WebSocket frame at all: that viewer is cut off, others are not.
        for hostile in (lambda one: one.send(b"\xff\xfe"), lambda one: one.send(b" " * 5000),
                        lambda one: one.connection.sendall(draw.randbytes(500))):
            one = self.viewer(port)
            hostile(one)
            with self.assertRaises(OSError):
                one.until(lambda message: False)
        send_raw(b"", os.urandom(100), b"\xff" * 60000)
        viewer.until(lambda message: message["type"] == "state")
        self.assertIsNone(dash.poll())

    def test_one_who_does_not_read_is_thinned_and_slows_nobody(self):
        dash, port = self.start_dash()
        self.start("run", "healthy.toml", "--realtime", "--bus", BUS, out="run.txt")
        idle = self.viewer(port)  # takes nothing of what comes
        viewer = self.viewer(port)
        viewer.until(lambda message: message.get("kind") == "healthy")
        before, cycles = self.resident_kB(dash), []
        while len(cycles) < 150:  # six seconds, as a rule
            cycles.append(viewer.until(lambda message: message["type"] == "state")["cycle"])
        self.assertEqual(cycles, sorted(cycles))
        self.assertGreater(cycles[-1], cycles[0] + 100)
        self.assertLess(self.resident_kB(dash), before + 2000)
        # It left off at some state, and now gets the newest, not all that it has missed. Before the first cycle a
        # state has none.
        idle_cycles = []
        idle.until(lambda message: message["type"] == "state" and (idle_cycles.append(message.get("cycle", -1)) or
                                                                   idle_cycles[-1] >= cycles[-1]))
        self.assertEqual(idle_cycles, sorted(idle_cycles))
        self.assertLessEqual(len(idle_cycles), len(cycles) + 50)

    @staticmethod
    def resident_kB(process):
        with open(f"/proc/{process.pid}/status", encoding="ascii") as file:
            return next(int(line.split()[1]) for line in file if line.startswith("VmRSS:"))

    def test_connections_that_never_ask(self):
        dash, port = self.start_dash()
        viewer = self.viewer(port)
        silent = [socket.create_connection(("127.0.0.1", port)) for _ in range(200)]
        for one in silent:
            self.addCleanup(one.close)
        halves = [one for one in silent if self.try_send(one, b"GET /live HTTP/1.1\r\nHost: ")]
        viewer.until(lambda message: message["type"] == "state")
        # Those beyond the most that are kept are closed at once, the others when they have been silent for 10 s.
        self.assertGreater(len(halves), 0)
        wait_for(lambda: self.asks(port), 30, 0.5)
        unmasked = self.viewer(port)
        unmasked.connection.sendall(b"\x81\x02{}")
        with self.assertRaises(OSError):
            unmasked.until(lambda message: False)
        viewer.until(lambda message: message["type"] == "state")
        self.assertIsNone(dash.poll())

    @staticmethod
    def try_send(connection, data):
        try:
            connection.sendall(data)
            return True
        except OSError:
            return False

    @staticmethod
    def asks(port):
        try:
            return status(port) == 200
        except OSError:
            return False


if __name__ == "__main__":
    enter_namespace(__file__)
    unittest.main()
