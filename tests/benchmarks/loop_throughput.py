#!/usr/bin/python3
"""Runs per core-minute of Hou's plant with its bank: `faultline campaign` beside the same loop written by hand.

  FAULTLINE=build/release/bin/faultline /usr/bin/python3 tests/benchmarks/loop_throughput.py [--seconds 5]

One run is 10 s at 100 Hz: plant, state feedback, six residuals, thresholds with dwell. The others do the arithmetic alone:
no CAN frames, no codec, no sampling, no decisions beyond which residuals fired, no database. One thread each.

- NumPy, one run after the other, as one writes it first
- SciPy, dlsim of the closed loop and of each filter: one call per run, in compiled code (Debian package python3-scipy)
- Octave, lsim's loop by matrix products in an m-file (Debian package octave)

What is not installed is left out.
"""
import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
FAULTLINE = os.environ.get("FAULTLINE", f"{ROOT}/build/release/bin/faultline")
STEPS = 1000
os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1")

OCTAVE = """
1;
function run(A, B, C, K, F, E, G, M, H, k_fault)
  x = zeros(3, 1); v = zeros(6, 1); above = zeros(6, 1); fired = false(6, 1);
  for k = 1:1000
    y = C * x; u = 1 - K * x;
    r = M * v - H * y; v = F * v - E * y + G * u;
    above = (above + 1) .* (abs(r) > 0.5); fired = fired | above >= 3;
    if k > 200, u(k_fault) += 1; end
    x = A * x + B * u;
  end
end
"""


def campaign(folder, seconds):
    """Runs per minute, of a sweep long enough for that many seconds on one thread."""
    sweep = open(f"{ROOT}/examples/hou2015/campaign/sweep.toml", encoding="utf-8").read()
    sweep = sweep.replace('scenario = "', f'scenario = "{ROOT}/examples/hou2015/campaign/')
    runs = 500
    while True:
        path = os.path.join(folder, f"sweep{runs}.toml")
        with open(path, "w", encoding="utf-8") as out:
            out.write(sweep.replace("runs     = 10000", f"runs     = {runs}"))
        done = subprocess.run([FAULTLINE, "campaign", path, "-j", "1", "-q", "-o", path + ".db", "--json", "-"],
                              capture_output=True, check=False)
        answer = json.loads(done.stdout)
        if answer["wall_s"] > 0.5 * seconds:
            return 60.0 * runs / answer["wall_s"]
        runs = int(runs * max(2.0, 0.9 * seconds / max(answer["wall_s"], 0.01)))


def matrices(folder):
    """Plant, gain and filters as the bench uses them."""
    import numpy as np
    bank = os.path.join(folder, "b.bank.json")
    subprocess.run([FAULTLINE, "design", f"{ROOT}/examples/hou2015/bank.toml", "-o", bank], check=True, capture_output=True)
    filters = json.load(open(bank, encoding="utf-8"))["filters"]
    A = np.array([[1, 1, 1], [0, -1, 2], [2, 0, -4.]])
    B = np.array([[1, 0, 1, 1], [0, 1, 1, 0], [0, 1, 0, 1.]])
    C = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 2.]])
    whole = np.zeros((7, 7))
    whole[:3, :3], whole[:3, 3:] = A * 0.01, B * 0.01
    power, exponential = np.eye(7), np.eye(7)
    for i in range(1, 20):
        power = power @ whole / i
        exponential = exponential + power
    A, B = exponential[:3, :3], exponential[:3, 3:]
    P = np.eye(3)
    for _ in range(3000):
        K = np.linalg.solve(np.eye(4) + B.T @ P @ B, B.T @ P @ A)
        P = A.T @ P @ (A - B @ K) + np.eye(3)
    stack = {letter: np.vstack([np.array(f[letter]) for f in filters]) for letter in "EGH"}
    stack["F"] = np.diag([f["F"][0][0] for f in filters])
    stack["M"] = np.diag([f["M"][0][0] for f in filters])
    return A, B, C, K, stack


def repeat(one, seconds):
    begin, runs = time.perf_counter(), 0
    while time.perf_counter() - begin < seconds:
        one(runs % 4)
        runs += 1
    return 60.0 * runs / (time.perf_counter() - begin)


def numpy_loop(A, B, C, K, f, fault):
    import numpy as np
    x, v = np.zeros(3), np.zeros(6)
    above, fired = np.zeros(6), np.zeros(6, bool)
    for k in range(STEPS):
        y, u = C @ x, 1.0 - K @ x
        r, v = f["M"] @ v - f["H"] @ y, f["F"] @ v - f["E"] @ y + f["G"] @ u
        above = (above + 1) * (abs(r) > 0.5)
        fired |= above >= 3
        if k > 200:
            u[fault] += 1.0
        x = A @ x + B @ u


def scipy_loop(A, B, C, K, f):
    """Plant, feedback and filters as one linear system, one dlsim per run."""
    import numpy as np
    from scipy import signal
    A_all = np.block([[A - B @ K, np.zeros((3, 6))], [-f["E"] @ C - f["G"] @ K, f["F"]]])
    B_all = np.block([[B, B], [f["G"], np.zeros((6, 4))]])
    C_all = np.hstack([-f["H"] @ C, f["M"]])
    system = signal.dlti(A_all, B_all, C_all, np.zeros((6, 8)), dt=0.01)

    def one(fault):
        inputs = np.ones((STEPS, 8))
        inputs[:, 4:] = 0.0
        inputs[201:, 4 + fault] = 1.0
        _, r, _ = signal.dlsim(system, inputs)
        exceeds = abs(r) > 0.5
        (exceeds[2:] & exceeds[1:-1] & exceeds[:-2]).any(axis=0)
    return one


def octave(A, B, C, K, f, seconds, folder):
    def text(matrix):
        return "[" + "; ".join(" ".join(repr(float(x)) for x in row) for row in matrix) + "]"
    path = os.path.join(folder, "loop.m")
    arguments = ", ".join(text(m) for m in (A, B, C, K, f["F"], f["E"], f["G"], f["M"], f["H"]))
    with open(path, "w", encoding="utf-8") as out:
        out.write(OCTAVE + f"t = tic; n = 0;\nwhile toc(t) < {seconds}\n  run({arguments}, mod(n, 4) + 1); n++;\nend\n"
                  "printf('%g\\n', 60 * n / toc(t));\n")
    return float(subprocess.run(["octave-cli", "--quiet", path], capture_output=True, check=True, text=True).stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=5.0)
    seconds = parser.parse_args().seconds
    with tempfile.TemporaryDirectory(prefix="faultline-throughput.") as folder:
        rows = [("faultline campaign (frames, codec, decisions, database)", campaign(folder, seconds))]
        try:
            A, B, C, K, f = matrices(folder)
            rows.append(("NumPy, the arithmetic alone", repeat(lambda fault: numpy_loop(A, B, C, K, f, fault), seconds)))
            try:
                rows.append(("SciPy dlsim, the arithmetic alone", repeat(scipy_loop(A, B, C, K, f), seconds)))
            except ImportError:
                print("SciPy is not installed (python3-scipy)", file=sys.stderr)
            if shutil.which("octave-cli"):
                rows.append(("Octave, the arithmetic alone", octave(A, B, C, K, f, seconds, folder)))
            else:
                print("Octave is not installed (octave)", file=sys.stderr)
        except ImportError:
            print("NumPy is not installed (python3-numpy)", file=sys.stderr)
        print(f"{'runs of 10 s at 100 Hz, one thread':<58} {'per minute':>11} {'of ours':>8}")
        for name, rate in rows:
            print(f"{name:<58} {rate:>11,.0f} {rate / rows[0][1]:>8.3f}")


if __name__ == "__main__":
    main()
