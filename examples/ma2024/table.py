#!/usr/bin/env python3
"""Designs and runs every observer of the comparison with Ma, Gao, Guo 2024 and prints one table.

    examples/ma2024/table.py [--faultline build/release/bin/faultline] [--keep FOLDER]

Each observer is designed by `faultline design` and run three times over 8,000 samples on the loop bus:
without a fault, with the paper's actuator fault (k = 2001 .. 6000), with its sensor fault (k = 3001 ..
5000). Behind each measured figure stands the reference figure in brackets. Alarms are counted sample by
sample from the logged residuals, without dwell: by component, and by the quadratic threshold.
"""

import argparse
import csv
import json
import math
import pathlib
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
SAMPLES = 8000
CLEARING = 300  # samples after a fault that an alarm may last
ACTUATOR = range(2001, 6001)
SENSOR = range(3001, 5001)
SETTLED = range(3500, 5001)  # where the estimate of the sensor fault is judged
MULTIPLIER = "a_0 = [-0.05]\nv = [50]"

# name, what it is, plant, options of [uio]; then the reference: rho (larger), beta on the grid, J_th,
# thresholds by component, nominal fault, delays and alarm shares (component / quadratic).
CASES = [
    ("A*", "decoupling, H-/Linf", "plant_euler.toml", "decoupling = 'full'\nalpha = [0.9]\n" + MULTIPLIER,
     (.920, 1.981, .1024, (.0350, .0943, .0161), .029, (4, 4), (.999, .999))),
    ("A*8", "the same, faster", "plant_euler.toml", "decoupling = 'full'\nalpha = [0.8]\n" + MULTIPLIER,
     (.868, 2.69, .208, (.0294, .1636, .0146), .050, (3, 4), (.999, .999))),
    ("A*7", "the same, fast", "plant_euler.toml", "decoupling = 'full'\nalpha = [0.7]\n" + MULTIPLIER,
     (.767, 3.04, .446, (.0286, .322, .0147), .103, (3, 5), (.970, .780))),
    ("B9", "decoupling, Linf only", "plant_euler.toml",
     "decoupling = 'full'\ncriterion = 'l_infinity'\nalpha = [0.9]",
     (.927, .365, .0479, (.0254, .0127, .0127), .057, (2, 4), (.9995, .999))),
    ("B8", "the same, faster", "plant_euler.toml",
     "decoupling = 'full'\ncriterion = 'l_infinity'\nalpha = [0.8]",
     (.862, .232, .0393, (.0255, .0128, .0128), .120, (2, 4), (.904, .763))),
    ("B7", "the same, fast", "plant_euler.toml",
     "decoupling = 'full'\ncriterion = 'l_infinity'\nalpha = [0.7]",
     (.757, .132, .0368, (.0255, .0127, .0127), .234, (4, 4), (.373, .239))),
    ("B5", "the same, very fast", "plant_euler.toml",
     "decoupling = 'full'\ncriterion = 'l_infinity'\nalpha = [0.5]",
     (.53, .059, .0362, None, .53, (23, 202), (.053, .018))),
    ("C", "no decoupling, Linf only", "plant_euler.toml",
     "decoupling = 'none'\ncriterion = 'l_infinity'\nalpha = [0.9]",
     (.930, .533, .0116, (.0106, .0045, .0008), .021, (1, 1), (.9998, .9998))),
    ("H", "no decoupling, y1 carried", "plant_euler.toml",
     "decoupling = 'none'\ncarry = ['y1']\ndrift_per_s = 0.1\nalpha = [0.9]\n" + MULTIPLIER,
     (.916, 1.657, .087, (.0279, .0723, .0007), .034, (2, 2), (.9995, .9995))),
    ("Z", "A* on the robot itself", "plant.toml", "decoupling = 'full'\nalpha = [0.9]\n" + MULTIPLIER,
     (.918, 1.877, .091, (.0329, .0828, .0169), .027, (3, 3), (.999, .999))),
]
INFEASIBLE = ("carried and decoupled", "plant_euler.toml",
              "decoupling = 'full'\ncarry = ['y1']\ndrift_per_s = 0.1\nalpha = [0.9]\n" + MULTIPLIER)
ESTIMATOR = "[uio.estimate]\nfaults = ['y1']\ndrift_per_s = 0.5\nalpha = [0.95]\ndecoupling = 'full'\n"
ESTIMATOR_REFERENCE = (.0026, .0074, .0147)  # rms, largest error, bound

FAULTS = {
    "none": "",
    "act": """
[[fault]]
target = "u1"
kind = "bias"
at_s = 20.01
until_s = 60.01
value = 0.2
[[fault]]
target = "u1"
kind = "sinusoid"
at_s = 20.01
until_s = 60.01
value = 0.1
frequency_Hz = 5.0
phase_rad = 0.3141592653589793
""",
    "sens": """
[[fault]]
target = "y1"
kind = "bias"
at_s = 30.01
until_s = 50.01
value = 0.2
""",
}


class Failure(Exception):
    pass


def run(arguments, codes=(0,)):
    done = subprocess.run([str(a) for a in arguments], capture_output=True, text=True)
    if done.returncode not in codes:
        raise Failure(f"{' '.join(map(str, arguments))} ended with {done.returncode}:\n{done.stderr or done.stdout}")
    return done


def write_bank(folder, plant, options):
    file = folder / "bank.toml"
    file.write_text(f"""schema = 1
name = "case"
plant = "{HERE / plant}"
method = "uio"
sample_time_s = 0.01
[decision]
threshold = "certified"
dwell = 1
settle = 1
[uio]
detect = ["u1"]
band_rad = [0, 0.1]
{options}
""")
    return file


def design(program, folder, plant, options, codes=(0,)):
    file = write_bank(folder, plant, options)
    run([program, "design", file, "-o", folder / "case.bank.json", "--json", folder / "design.json"], codes)
    return json.loads((folder / "design.json").read_text())


def simulate(program, folder, plant, fault):
    scenario = folder / f"{fault}.toml"
    method = "" if plant == "plant_euler.toml" else "[simulation]\nmethod = \"rk4\"\n"
    scenario.write_text(f"""schema = 1
name = "{fault}"
plant = "{HERE / plant}"
bank = "case.bank.json"
dbc = "{HERE / 'bench.dbc'}"
duration_s = {SAMPLES / 100}
seed = 1
initial_state = [-0.15, 0, 0.2, 0.4]
{method}[controller]
kind = "none"
amplitude = [2.0]
frequency_Hz = [1.0]
[[disturbance]]
target = "all"
kind = "uniform"
[[noise]]
target = "all"
kind = "uniform"
{FAULTS[fault]}""")
    log = folder / f"{fault}.lcm"
    run([program, "run", scenario, "--log", log])
    run([program, "log", "export", log, "-o", folder / fault, "--channel", "RESIDUAL"])
    with open(folder / fault / "residual.csv", newline="") as file:
        return list(csv.DictReader(file))


def numbers(rows, columns):
    return [[float(row[c]) for c in columns] for row in rows]


class Residuals:
    """What the detecting observer left in a log: rows, their thresholds, and the quadratic one."""

    def __init__(self, rows, bank):
        detection = next(f for f in bank["filters"] if f["name"] == "detection")
        course = detection["observer"]["course"]
        names = [c for c in rows[0] if c + "_bound" in rows[0] and c.startswith("detection")]
        self.rows = numbers(rows, names)
        self.bounds = numbers(rows, [n + "_bound" for n in names])
        self.weight = course["weight"]
        self.norm = course["norm"]

    def component_alarms(self):
        return [any(abs(r) > b for r, b in zip(row, bound)) for row, bound in zip(self.rows, self.bounds)]

    def quadratic_alarms(self):
        alarms = []
        for k, row in enumerate(self.rows):
            weighted = [sum(w * r for w, r in zip(line, row)) for line in self.weight]
            alarms.append(math.hypot(*weighted) > self.norm[min(k, len(self.norm) - 1)])
        return alarms


def false_alarms(alarms, window):
    return sum(a for k, a in enumerate(alarms)
               if not (window and window.start <= k < window.stop + CLEARING))


def delay(alarms, window):
    return next((k - window.start for k in window if k < len(alarms) and alarms[k]), None)


def share(alarms, window):
    return sum(alarms[k] for k in window) / len(window)


def estimate_errors(rows, window, size):
    errors = [abs(float(rows[k]["size_y1"]) - size) for k in window]
    return math.sqrt(sum(e * e for e in errors) / len(errors)), max(errors)


def pair(values, form):
    return "/".join("-" if v is None else form.format(v) for v in values)


def show_case(program, folder, case, out):
    name, text, plant, options, (rho, beta, j_th, components, nominal, delays, shares) = case
    folder.mkdir()
    found = design(program, folder, plant, options)
    proof = next(f for f in found["observer_filters"] if f["name"] == "detection")
    bank = json.loads((folder / "case.bank.json").read_text())
    runs = {fault: Residuals(simulate(program, folder, plant, fault), bank) for fault in FAULTS}
    false = 0
    for fault, window in (("none", None), ("act", ACTUATOR), ("sens", SENSOR)):
        false += false_alarms(runs[fault].component_alarms(), window)
        false += false_alarms(runs[fault].quadratic_alarms(), window)
    alarms = runs["act"].component_alarms(), runs["act"].quadratic_alarms()
    reference = "-" if components is None else " ".join(f"{c:.4f}" for c in components)
    measured = " ".join(f"{c:.4f}" for c in proof["component_threshold"])
    out(f"{name:<4} {text:<26}"
        f" {max(proof['vertex_radius']):.3f} ({rho:.3f})"
        f"  {format(proof['beta'], '6.3f') if proof['beta'] else '     -'} ({beta:.3f})"
        f"  {proof['j_th']:.4f} ({j_th:.4f})"
        f"  {measured} ({reference})"
        f"  {proof['nominal_fault'][0]:.3f} ({nominal:.3f})"
        f"  {pair([delay(a, ACTUATOR) for a in alarms], '{}')} ({pair(delays, '{}')})"
        f"  {pair([share(a, ACTUATOR) for a in alarms], '{:.3f}')} ({pair(shares, '{:g}')})"
        f"  {false}")
    return false


def show_estimator(program, folder, out):
    folder.mkdir()
    found = design(program, folder, "plant_euler.toml",
                   "decoupling = 'none'\ncarry = ['y1']\ndrift_per_s = 0.1\nalpha = [0.9]\n" + MULTIPLIER
                   + "\n" + ESTIMATOR)
    proof = next(f for f in found["observer_filters"] if f.get("estimates") == "y1")
    rows = simulate(program, folder, "plant_euler.toml", "sens")
    rms, largest = estimate_errors(rows, SETTLED, 0.2)
    out(f"\nEstimate of the sensor fault 0.2: rms error {rms:.4f} ({ESTIMATOR_REFERENCE[0]:.4f}), largest "
        f"{largest:.4f} ({ESTIMATOR_REFERENCE[1]:.4f}), proved bound {proof['estimate_bound']:.4f} "
        f"({ESTIMATOR_REFERENCE[2]:.4f}), settled after {proof['settle_samples']} samples (12)")
    if largest > proof["estimate_bound"]:
        raise Failure("the estimate left its proved bound")


def show_infeasible(program, folder, out):
    folder.mkdir()
    text, plant, options = INFEASIBLE
    found = design(program, folder, plant, options, codes=(1,))
    reason = found["observers"][0]["trials"][0]["reason"]
    out(f"\n{text}: infeasible, as it must be: {reason}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--faultline", default=HERE.parent.parent / "build/release/bin/faultline")
    parser.add_argument("--keep", type=pathlib.Path, help="folder for banks, scenarios and logs; must not exist")
    parser.add_argument("--case", action="append", help="only this one; may be repeated: " +
                        ", ".join(case[0] for case in CASES))
    arguments = parser.parse_args()
    program = pathlib.Path(arguments.faultline).resolve()
    cases = [c for c in CASES if not arguments.case or c[0] in arguments.case]

    def out(text):
        print(text, flush=True)

    with tempfile.TemporaryDirectory(prefix="ma2024-") as temporary:
        root = arguments.keep or pathlib.Path(temporary) / "cases"
        root.mkdir()
        out("measured (reference). Delay in samples and share of alarms while the actuator fails: by component / "
            "quadratic.")
        out(f"{'':<31} {'rho':<13}  {'beta, certified':<14}  {'J_th':<15}  {'thresholds by component':<45}  "
            f"{'nominal':<13}  {'delay':<9}  {'alarm share':<25}  false")
        false = 0
        for case in cases:
            false += show_case(program, root / case[0].replace("*", "s"), case, out)
        if not arguments.case:
            show_estimator(program, root / "estimator", out)
            show_infeasible(program, root / "infeasible", out)
        out("")
        for line in NOTES:
            out(line)
    if false:
        raise Failure(f"{false} false alarms, expected none")


NOTES = (
    "beta: certified by the inequalities, which bound it from below; the reference's is the true one on a grid.",
    "C: without decoupling and without H-, many gains have the same J_th; which one is found decides the thresholds.",
    "Delays and shares: other noise than the reference's (one seed each), and Linf gains that are as good but not the",
    "same. Near the threshold (B5: a fault of 0.3 at most against 0.53) a delay is luck.",
    "Estimate: the bound is 1.05 times that of the noise and holds, proved, for faults up to 1 from the sample printed",
    "on; the reference's 12 samples are those to 95 % of a step.",
)


if __name__ == "__main__":
    try:
        main()
    except (Failure, OSError) as error:
        print(f"table: {error}", file=sys.stderr)
        sys.exit(1)
