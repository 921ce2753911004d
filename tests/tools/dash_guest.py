#!/usr/bin/python3
"""The bench and `faultline dash` on a vcan, for dash_page_test: inside tools/with-vcan.

    dash_guest.py PORT SCENARIO

Serves the tunnel on its standard streams; the texts "dash", "bench" and "end dash" start and end them.
"""
import os
import signal
import socket
import subprocess
import sys

from faultline_program import program
from multicast_namespace import URL
from stream_tunnel import Tunnel

PORT, SCENARIO = int(sys.argv[1]), sys.argv[2]
COMMANDS = {
    "dash": ["dash", "--listen", f"127.0.0.1:{PORT}", "--lcm", URL],
    "bench": ["run", SCENARIO, "--realtime", "--bus", "can:vcan0", "--no-log", "--lcm", URL, "-q", "--priority", "0"],
}
running = {}


def end(name):
    process = running.pop(name)
    process.send_signal(signal.SIGINT)
    process.wait()


def on_text(text):
    if text.startswith("end "):
        end(text[4:])
    else:
        running[text] = subprocess.Popen([program(), *COMMANDS[text]], stdin=subprocess.DEVNULL, stdout=sys.stderr)
    tunnel.send(0, f"did {text}".encode())


if __name__ == "__main__":
    tunnel = Tunnel(0, os.dup(1), on_text, lambda: socket.create_connection(("127.0.0.1", PORT)))
    tunnel.run()
    for name in list(running):
        end(name)
