#!/usr/bin/env python3
"""Ordinary observer beside the robust one: false alarms and delays over the friction, same noise.

    examples/jin/compare.py [FAULTLINE]

FAULTLINE: the program; build/release/bin/faultline of this checkout if absent. Per bank, friction and
sensor: how long, of the time without a fault, something is named; after how long the sensor is named
that failed, and for how much of the fault's time. Three seeds each.
"""
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

FOLDER = pathlib.Path(__file__).resolve().parent
SEEDS = (1, 2, 3)
START, FAULT, END, STOP = 0.4, 4.0, 8.0, 10.0
SETTLED = 8.2  # the residuals have forgotten the fault

SCENARIO = """
schema = 1
name   = "compare"
include = ["{folder}/common.toml"]
plant  = "{folder}/plant.toml"
bank   = "{folder}/{bank}"
dbc    = "{folder}/bench.dbc"
duration_s = {stop}
seed   = {seed}
[simulation.uncertainty]
friction = {friction}
[[fault]]
target = "{sensor}"
kind   = "bias"
at_s   = {fault}
until_s = {end}
value  = 2.0
"""


def verdicts(program, folder, **values):
    """[(from, until, verdict, faults)] of one run."""
    scenario = folder / "compare.toml"
    scenario.write_text(SCENARIO.format(folder=FOLDER, stop=STOP, fault=FAULT, end=END, **values))
    result = folder / "result.json"
    subprocess.run([program, "run", scenario, "--no-log", "--json", result], check=False,
                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    entries = json.loads(result.read_text())["verdicts"]
    times = [entry["t_s"] for entry in entries] + [STOP]
    return [(times[i], times[i + 1], entry["verdict"], entry["faults"])
            for i, entry in enumerate(entries)]


def overlap(begin, end, low, high):
    return max(0.0, min(end, high) - max(begin, low))


def measure(program, folder, bank, friction, sensor):
    alarm, named, delays = [], [], []
    for seed in SEEDS:
        entries = verdicts(program, folder, bank=bank, friction=friction, sensor=sensor, seed=seed)
        quiet = (FAULT - START) + (STOP - SETTLED)
        wrong = sum(overlap(a, b, START, FAULT) + overlap(a, b, SETTLED, STOP)
                    for a, b, verdict, _ in entries if verdict not in ("healthy", "inhibited"))
        right = [(a, b) for a, b, verdict, faults in entries
                 if verdict == "isolated" and faults == [sensor]]
        alarm.append(wrong / quiet)
        named.append(sum(overlap(a, b, FAULT, END) for a, b in right) / (END - FAULT))
        first = [max(a, FAULT) for a, b in right if overlap(a, b, FAULT, END) > 0]
        if first and alarm[-1] < 0.5:
            delays.append(first[0] - FAULT)
    delay = f"{1e3 * statistics.median(delays):4.0f} ms" if delays else "      -"
    return statistics.mean(alarm), statistics.mean(named), delay


def main():
    program = sys.argv[1] if len(sys.argv) > 1 else \
        FOLDER.parent.parent / "build" / "release" / "bin" / "faultline"
    print("bank       friction  sensor    false alarm    delay   named of the fault's time")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for label, bank in (("ordinary", "bank_ordinary.toml"), ("robust", "bank.toml")):
            for friction in (-1.0, -0.5, 0.0, 0.5, 1.0):
                for sensor in ("i", "w_motor", "w_load"):
                    alarm, named, delay = measure(program, folder, bank, friction, sensor)
                    print(f"{label:<9}  {friction:8.1f}  {sensor:<8}  {alarm:10.1%}  {delay}  "
                          f"{named:10.1%}")


if __name__ == "__main__":
    main()
