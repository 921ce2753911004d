#!/usr/bin/python3
"""Latency of the diagnosis beside a bare reader of the same bus and beside cyclictest, all in one run.

  FAULTLINE=build/release/bin/faultline tests/benchmarks/latency_benchmark.py [--seconds 20] [BUS...]

Each BUS (default: loop and a UDP group) carries examples/hou2015/realtime_1khz.toml; `--probe` is the bare reader,
a thread of the same priority that reads and counts. cyclictest (Debian package rt-tests) runs a 1 kHz thread of the
same priority meanwhile. Medians and p99 are compared as ratios: on a shared machine nothing else means much.
Needs the right to SCHED_FIFO (faultline doctor).
"""
import argparse
import glob
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
EXAMPLE = f"{ROOT}/examples/hou2015"
PRIORITY = 80


def percentile(counts, percent):
    """Of {value: count}."""
    rank, below = sum(counts.values()) * percent / 100, 0
    for value in sorted(counts):
        below += counts[value]
        if below >= rank:
            return value
    return float("nan")


def cyclictest(seconds):
    return subprocess.Popen(["cyclictest", "-q", "-m", f"-p{PRIORITY}", "-i1000", "-h10000", f"-D{seconds}"],
                            stdout=subprocess.PIPE, text=True)


def cyclictest_latency(text):
    counts = {int(us): int(count) for us, count in re.findall(r"^(\d+)\s+(\d+)$", text, re.MULTILINE)}
    return {"p50": percentile(counts, 50), "p99": percentile(counts, 99)}


def run(program, folder, bus, seconds):
    process = subprocess.run([program, "run", "realtime_1khz.toml", "--realtime", "--probe", "--quiet", "--bus", bus,
                              "--priority", str(PRIORITY), "--log", "run.lcm", "--json", "-"],
                             cwd=folder, stdout=subprocess.PIPE, timeout=seconds + 60, check=False)
    if process.returncode != 0:
        sys.exit(f"faultline run --bus {bus} ended with {process.returncode}")
    return json.loads(process.stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=int, default=20)
    parser.add_argument("buses", metavar="BUS", nargs="*", default=["loop", "udp:239.74.163.2:43113"])
    arguments = parser.parse_args()
    program = os.path.abspath(os.environ.get("FAULTLINE", f"{ROOT}/build/release/bin/faultline"))
    folder = tempfile.mkdtemp(prefix="faultline-latency.")
    try:
        for file in glob.glob(f"{EXAMPLE}/*.toml") + glob.glob(f"{EXAMPLE}/*.dbc"):
            shutil.copy(file, folder)
        with open(f"{folder}/realtime_1khz.toml", "r+", encoding="utf-8") as scenario:
            text = scenario.read().split("[[fault]]")[0]
            scenario.seek(0)
            scenario.truncate()
            scenario.write(re.sub(r"(?m)^duration_s = .*", f"duration_s = {arguments.seconds}", text))
        row = "{:<26}{:<22}{:>10}{:>10}{:>12}{:>12}".format
        print(row("bus", "latency, us", "p50", "p99", "p50 : bare", "p99 : bare"))
        for bus in arguments.buses:
            beside = cyclictest(arguments.seconds)
            result = run(program, folder, bus, arguments.seconds)
            latencies = {stage["stage"]: {"p50": stage["p50_us"], "p99": stage["p99_us"]} for stage in result["latency"]}
            latencies["cyclictest"] = cyclictest_latency(beside.communicate(timeout=60)[0])
            bare = latencies["probe: stamp->read"]
            for name in ("total", "stamp->read", "probe: stamp->read", "cyclictest", "due->sent"):
                found = latencies[name]
                print(row(bus, name, f"{found['p50']:.1f}", f"{found['p99']:.1f}",
                          f"{found['p50'] / bare['p50']:.2f}", f"{found['p99'] / bare['p99']:.2f}"))
            frames, thread = result["frames"], result["diagnosis_thread"]
            print(f"  frames sent {frames['sent']}, received {frames['received']}, dropped {frames['dropped']}; "
                  f"allocations {thread['allocations']}, page faults {thread['page_faults']}")
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
