#!/usr/bin/env python3
"""Writes replay.bank.json and replay_log.txt beside itself; see README.md.

A Python float is an IEEE double and its operations are rounded one by one, without contraction: the
residuals below are what the run time must give to the bit, computed by other code. The order of a
sum is part of the run time's contract: states first, then outputs, then inputs.
"""
import json
import math
import pathlib

HERE = pathlib.Path(__file__).parent
SAMPLE_TIME_S = 0.01
STEPS = 200
FAULTS = ["u1", "u2", "u3", "u4"]


def pseudo_random(seed):
    """Numbers in [-1, 1) of a linear congruential generator (Knuth's MMIX constants)."""
    state = seed
    while True:
        state = (6364136223846793005 * state + 1442695040888963407) % 2**64
        yield (state >> 11) / 2**52 - 1.0


NUMBERS = pseudo_random(1)


def matrix(rows, cols, scale=1.0):
    return [[scale * next(NUMBERS) for _ in range(cols)] for _ in range(rows)]


def hou_filter(name, ignores, continuous):
    """A filter of order one: y by first-order hold, folded into v = w + E_1 y; u by zero-order hold."""
    pole = continuous["F"][0][0]
    decay = math.exp(pole * SAMPLE_TIME_S)
    step = (decay - 1.0) / pole
    ramp = (decay - 1.0 - pole * SAMPLE_TIME_S) / (pole * pole * SAMPLE_TIME_S)
    e_row, g_row, h_row = continuous["E"][0], continuous["G"][0], continuous["H"][0]
    m = continuous["M"][0][0]
    return {
        "name": name,
        "ignores": [FAULTS[j - 1] for j in ignores],
        "F": [[decay]],
        "E": [[(step - ramp + decay * ramp) * e for e in e_row]],
        "G": [[step * g for g in g_row]],
        "M": [[m]],
        "H": [[h + m * ramp * e for h, e in zip(h_row, e_row)]],
        "K": [[0.0] * 4],
    }


def made_up_filter(name, order, rows):
    """Any order, any rows: |F| sums to less than one in each row, so it is stable."""
    return {
        "name": name,
        "ignores": [],
        "F": matrix(order, order, 0.9 / max(order, 1)),
        "E": matrix(order, 3),
        "G": matrix(order, 4),
        "M": matrix(rows, order),
        "H": matrix(rows, 3),
        "K": matrix(rows, 4),
    }


def make_bank():
    exact = json.loads((HERE / "hou_reference.json").read_text())["exact_generators_paper_sign"]
    filters = [hou_filter(name, [int(c) for c in name[1:]], f) for name, f in exact.items()]
    filters += [made_up_filter(f"order{d}", d, rows) for d, rows in [(3, 2), (0, 1), (4, 3), (2, 1)]]
    for f in filters:
        f["sees"] = ["none" if name in f["ignores"] else "steady" for name in FAULTS]
        f["threshold"] = 0.05
        f["forget_samples"] = 100
        f["L"] = [[0.0] * 4 for _ in f["F"]]
        f["J"] = [[0.0] * 4 for _ in f["H"]]
        f["certificate"] = {
            "spectral_radius": 0.9,
            "input_gain": [0.0] * 4,
            "disturbance_gain": [],
            "fault_gain": [0.0] * 4,
            "dc_gain": [0.0] * 4,
            "band_gain": [0.0] * 4,
            "band_Hz": 1.0,
            "margin": [0.0] * 4,
            "smallest_fault": [0.0] * 4,
            "delay_s": [0.0] * 4,
            "rank": {"dim_w": 2, "dim_s": 2, "smallest_kept": 1.0, "largest_dropped": 0.0,
                     "tolerance_min": 1e-12, "tolerance_max": 1e-6},
        }
    return {
        "schema": 1,
        "name": "replay",
        "method": "geometric",
        "plant": {"name": "hou2015", "digest": "none"},
        "request_digest": "none",
        "domain": "continuous",
        "sample_time_s": SAMPLE_TIME_S,
        "concurrent": 2,
        "inputs": ["u1", "u2", "u3", "u4"],
        "outputs": ["y1", "y2", "y3"],
        "faults": FAULTS,
        "fault_sizes": [1.0] * 4,
        "operating_point": {"u": [0.25, -0.5, 0.0, 1.0], "y": [0.1, 0.2, -0.3]},
        "disturbances": [],
        "decision": {"dwell": 3, "settle": 3, "window": 50},
        "isolability": {"signatures_distinct": True, "strongly_isolable": False, "list_complete": True,
                        "confusable": [{"faults": FAULTS, "weights": [1.0, 0.5, -0.5, -0.5]}]},
        "filters": filters,
    }


def row_product(row_v, v, row_y, y, row_u, u):
    total = 0.0
    for a, b in zip(row_v, v):
        total += a * b
    for a, b in zip(row_y, y):
        total += -a * b
    for a, b in zip(row_u, u):
        total += a * b
    return total


def replay(bank):
    point = bank["operating_point"]
    states = [[0.0] * len(f["F"]) for f in bank["filters"]]
    for _ in range(STEPS):
        y = [10.0 * next(NUMBERS) for _ in range(3)]
        u = [10.0 * next(NUMBERS) for _ in range(4)]
        dy = [a - b for a, b in zip(y, point["y"])]
        du = [a - b for a, b in zip(u, point["u"])]
        residual, evaluation = [], []
        for i, f in enumerate(bank["filters"]):
            v = states[i]
            r = [row_product(m, v, h, dy, k, du) for m, h, k in zip(f["M"], f["H"], f["K"])]
            states[i] = [row_product(a, v, e, dy, g, du) for a, e, g in zip(f["F"], f["E"], f["G"])]
            total = 0.0
            for value in r:
                total += value * value
            residual += r
            evaluation.append(abs(r[0]) if len(r) == 1 else math.sqrt(total))
        yield y + u + residual + evaluation


def main():
    bank = make_bank()
    (HERE / "replay.bank.json").write_text(json.dumps(bank, indent=1) + "\n")
    lines = [" ".join(value.hex() for value in line) for line in replay(bank)]
    (HERE / "replay_log.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
