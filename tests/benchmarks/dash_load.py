#!/usr/bin/python3
"""What three viewers of `faultline dash` cost a bench: 105 residuals at 200 Hz in real time, with them and without, by
turns; the diagnosis's latencies of each run side by side, and the memory of the dashboard.

    dash_load.py [--seconds 60] [--pairs 2]        FAULTLINE names the program; in a network namespace of its own
"""
import argparse
import itertools
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "tools"))
from faultline_program import program, wait_for  # noqa: E402
from multicast_namespace import URL, enter_namespace  # noqa: E402
from web_socket import WebSocket  # noqa: E402

CHANNELS = 15  # one residual for each pair of them that it ignores


def names(letter):
    return [f"{letter}{i + 1}" for i in range(CHANNELS)]


def matrix(entry):
    return "[" + ",\n ".join(str([entry(i, j) for j in range(CHANNELS)]) for i in range(CHANNELS)) + "]"


def dbc():
    text = 'VERSION ""\nBU_: Plant Controller\n\nBO_ 256 Sync: 8 Plant\n'
    text += ' SG_ SyncCycle : 0|32@1+ (1,0) [0|0] "" Controller\n SG_ SyncCommandCycle : 32|32@1+ (1,0) [0|0] "" Controller\n'
    roles = 'BA_ "FaultlineRole" SG_ 256 SyncCycle 1;\nBA_ "FaultlineRole" SG_ 256 SyncCommandCycle 3;\n'
    for base, letter, sender, name in ((272, "y", "Plant", "Sensors"), (304, "u", "Controller", "Commands")):
        for k in range((CHANNELS + 1) // 2):
            text += f"\nBO_ {base + k} {name}{k}: 8 {sender}\n"
            for slot, channel in enumerate(names(letter)[2 * k:2 * k + 2]):
                text += f' SG_ {channel} : {24 * slot}|24@1- (0.0001,0) [0|0] "" Vector__XXX\n'
            text += f' SG_ {name}{k}Cycle : 48|8@1+ (1,0) [0|0] "" Vector__XXX\n'
            roles += f'BA_ "FaultlineRole" SG_ {base + k} {name}{k}Cycle 2;\n'
    return (text + '\nBA_DEF_ SG_ "FaultlineRole" ENUM "none","sync","cycle","command_cycle";\n'
            'BA_DEF_DEF_ "FaultlineRole" "none";\n' + roles)


def write_example(folder, seconds):
    files = {
        "plant.toml": f'schema = 1\nname = "wide"\ntime = "continuous"\n[states]\nnames = {names("x")}\n'
                      f'[inputs]\nnames = {names("u")}\n[outputs]\nnames = {names("y")}\n[dynamics]\n'
                      f'A = {matrix(lambda i, j: -2.0 if i == j else 0.05 if abs(i - j) == 1 else 0.0)}\n'
                      f'B = {matrix(lambda i, j: 1.0 if i == j else 0.0)}\nC = {matrix(lambda i, j: 1.0 if i == j else 0.0)}\n'
                      '[faults]\nactuators = "all"\n',
        "bank.toml": 'schema = 1\nname = "wide"\nplant = "plant.toml"\nmethod = "geometric"\nconcurrent = 2\n'
                     'poles = [-10.0]\nsample_time_s = 0.005\n[decision]\nthreshold = 0.5\n',
        "bench.dbc": dbc(),
        "wide.toml": 'schema = 1\nname = "wide"\nplant = "plant.toml"\nbank = "wide.bank.json"\ndbc = "bench.dbc"\n'
                     f'duration_s = {seconds}\n[controller]\nkind = "none"\n',
    }
    for name, text in files.items():
        with open(os.path.join(folder, name), "w", encoding="utf-8") as file:
            file.write(text.replace("'", '"'))
    subprocess.run([program(), "design", "bank.toml", "-o", "wide.bank.json"], cwd=folder, check=True,
                   stdout=subprocess.DEVNULL)


def resident_kB(pid):
    with open(f"/proc/{pid}/status", encoding="ascii") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmRSS:"))


class Viewers:
    """`faultline dash` with viewers that take all that comes."""

    def __init__(self, folder, count):
        self.dash = subprocess.Popen([program(), "dash", "--listen", "127.0.0.1:0", "--lcm", URL], cwd=folder,
                                     stdout=subprocess.PIPE, text=True)
        port = int(self.dash.stdout.readline().split(":")[2].split("/")[0])
        self.states, self.memory_kB, self.is_over = 0, [], False
        self.lock = threading.Lock()
        self.threads = [threading.Thread(target=self.view, args=(port,)) for _ in range(count)]
        self.threads.append(threading.Thread(target=self.weigh))
        for thread in self.threads:
            thread.start()

    def view(self, port):
        viewer = WebSocket(port, "/live")
        while not self.is_over:
            viewer.receive_size()
            with self.lock:
                self.states += 1
        viewer.close()

    def weigh(self):
        while not self.is_over:
            self.memory_kB.append(resident_kB(self.dash.pid))
            time.sleep(1.0)

    def end(self):
        self.is_over = True
        for thread in self.threads:
            thread.join()
        self.dash.send_signal(signal.SIGINT)
        self.dash.wait()
        self.dash.stdout.close()


def run(folder):
    subprocess.run([program(), "run", "wide.toml", "--realtime", "--no-log", "-q", "--lcm", URL, "--bus",
                    "udp:239.74.163.2:43113", "--json", "run.json"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    with open(os.path.join(folder, "run.json"), encoding="utf-8") as file:
        return json.load(file)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--pairs", type=int, default=2)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="faultline-dash-load.") as folder:
        write_example(folder, options.seconds)
        p99 = {True: [], False: []}  # of `total`: from the deadline's frames to the decision
        for pair, has_viewers in itertools.product(range(options.pairs), (False, True)):
            viewers = Viewers(folder, 3) if has_viewers else None
            result = run(folder)
            if viewers:
                viewers.end()
            stages = {stage["stage"]: stage for stage in result["latency"]}
            text = ", ".join(f"{name} p50 {stage['p50_us']:.0f} p99 {stage['p99_us']:.0f}"
                             for name, stage in stages.items())
            p99[has_viewers].append(stages["total"]["p99_us"])
            print(f"pair {pair + 1}, {'three viewers' if viewers else 'no viewer    '}: {text} us"
                  f"; overruns {result['cycles']['overruns']}", flush=True)
            if viewers:
                first, last = viewers.memory_kB[len(viewers.memory_kB) // 4], viewers.memory_kB[-1]
                print(f"   dash: {viewers.states} states seen, {first} kB after a quarter, {last} kB at the end")
        ratio = statistics.median(p99[True]) / statistics.median(p99[False])
        print(f"p99 of `total` with viewers / without: {ratio:.2f}")


if __name__ == "__main__":
    enter_namespace(__file__)
    main()
