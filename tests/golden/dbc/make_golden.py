#!/usr/bin/env python3
"""Golden decodes of the DBC files in this folder, computed in exact rationals.

Shares nothing with the project: its own tiny DBC reader (regular expressions, one signal at a time),
its own bit reader (one bit at a time) and fractions.Fraction for raw * factor + offset, taken from
the decimal text of the file. Writes golden.txt: for each payload

    frame FILE MESSAGE PAYLOAD_HEX
    value SIGNAL RAW VALUE

RAW is the signal's bits as an unsigned number. VALUE is the exact result rounded once to a double,
written so that it reads back the same ("nan", "inf" for floats that are). Signals that a frame does
not carry, or that have no value (factor zero), are not listed.
Run: python3 make_golden.py > golden.txt
"""
import pathlib
import random
import re
import struct
from fractions import Fraction

FOLDER = pathlib.Path(__file__).parent
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
SIGNAL = re.compile(
    r"\bSG_\s+(?P<name>\S+?)\s*(?P<mark>\s[mM][0-9M]*)?\s*:\s*(?P<start>\S+?)\s*\|\s*(?P<bits>\S+?)\s*@\s*"
    r"(?P<order>[01])\s*(?P<sign>[-+])\s*\(\s*(?P<factor>" + NUMBER + r")\s*,\s*(?P<offset>" + NUMBER
    + r")\s*\)\s*\[")
MESSAGE = re.compile(r"\bBO_\s+(?P<id>\S+)\s+(?P<name>[^\s:]+)\s*:\s*(?P<length>\S+)")
PSEUDO = 0xC0000000


def whole(text):
    value = Fraction(text)
    assert value.denominator == 1
    return int(value)


def blank_strings(text):
    """Strings replaced by "", line by line, so that one without end costs its line only."""
    return re.sub(r'"[^"\n]*("|$)', '""', text, flags=re.M)


def read_dbc(path):
    text = path.read_bytes().decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
    text = blank_strings(re.sub(r"(?m)^\s*//.*$", "", text))
    messages = {}
    heads = list(MESSAGE.finditer(re.sub(r"BO_TX_BU_", "##_TX_BU_", text)))
    heads = [head for head in heads if not re.search(r"(CM_|BA_\s+\"\")\s+$", text[:head.start()])]
    for number, head in enumerate(heads):
        if not re.fullmatch(NUMBER, head["id"]):
            continue  # no identifier, no message
        file_id = whole(head["id"])
        if file_id == PSEUDO:
            continue
        end = heads[number + 1].start() if number + 1 < len(heads) else len(text)
        signals = {}
        for found in SIGNAL.finditer(text, head.end(), end):
            mark = (found["mark"] or "").strip()
            select = re.fullmatch(r"m(\d+)M?", mark)
            signals[found["name"]] = {
                "start": whole(found["start"]), "bits": whole(found["bits"]),
                "intel": found["order"] == "1", "signed": found["sign"] == "-",
                "factor": Fraction(found["factor"]), "offset": Fraction(found["offset"]),
                "is_root": mark == "M", "float": 0,
                "ranges": [(int(select[1]), int(select[1]))] if select else None, "mux": None}
        messages[file_id] = {"name": head["name"], "length": whole(head["length"]), "signals": signals}
    for found in re.finditer(r"(?m)^\s*SIG_VALTYPE_\s+(\d+)\s+(\S+?)\s*:?\s+([0-2])\s*;", text):
        messages[int(found[1])]["signals"][found[2]]["float"] = int(found[3])
    for found in re.finditer(r"(?m)^\s*SG_MUL_VAL_\s+(\d+)\s+(\S+)\s+(\S+)\s+([^;]*);", text):
        signal = messages[int(found[1])]["signals"][found[2]]
        signal["mux"] = found[3]
        signal["ranges"] = [tuple(int(n) for n in part.split("-")) for part in found[4].split(",")]
    for message in messages.values():
        roots = [name for name, signal in message["signals"].items() if signal["is_root"]]
        for signal in message["signals"].values():
            if signal["ranges"] and signal["mux"] is None:
                signal["mux"] = roots[0]
    return messages


def raw_bits(signal, payload):
    """Unsigned number of the signal's bits, or None if they are not all there."""
    positions = []
    position = signal["start"]
    for _ in range(signal["bits"]):
        positions.append(position)
        if signal["intel"]:
            position += 1
        else:
            position = position + 15 if position % 8 == 0 else position - 1
    if signal["intel"]:
        positions.reverse()
    value = 0
    for position in positions:
        if position // 8 >= len(payload):
            return None
        value = value << 1 | payload[position // 8] >> position % 8 & 1
    return value


def is_selected(message, signal, payload):
    while signal["mux"] is not None:
        parent = message["signals"][signal["mux"]]
        value = raw_bits(parent, payload)
        if value is None or not any(a <= value <= b for a, b in signal["ranges"]):
            return False
        signal = parent
    return True


def decode(signal, payload):
    """(raw, value) or None."""
    bits = raw_bits(signal, payload)
    if bits is None or signal["factor"] == 0 or not 1 <= signal["bits"] <= 64:
        return None
    if signal["float"]:
        code, size = {1: ("<If", 32), 2: ("<Qd", 64)}[signal["float"]]
        if signal["bits"] != size:
            return None
        number = struct.unpack("<" + code[2], struct.pack("<" + code[1], bits))[0]
        if number != number or number in (float("inf"), float("-inf")):
            return bits, number
        raw = Fraction(number)
    else:
        is_negative = signal["signed"] and bits >> (signal["bits"] - 1)
        raw = Fraction(bits - (1 << signal["bits"]) if is_negative else bits)
    exact = raw * signal["factor"] + signal["offset"]
    return bits, exact.numerator / exact.denominator  # rounded correctly, once


def payloads(message, generator):
    length = min(message["length"], 64)
    yield bytes(length)
    yield bytes([255] * length)
    for _ in range(12):
        yield bytes(generator.randrange(256) for _ in range(length))
    # Raw values near the zero of each signal: there cancellation shows.
    for signal in message["signals"].values():
        if signal["float"] or signal["factor"] == 0 or signal["offset"] == 0:
            continue
        centre = round(-signal["offset"] / signal["factor"])
        for raw in (centre - 1, centre, centre + 1):
            if not 0 <= raw < 1 << (signal["bits"] - (1 if signal["signed"] else 0)):
                continue
            payload = bytearray(generator.randrange(256) for _ in range(length))
            position = signal["start"]
            positions = []
            for _ in range(signal["bits"]):
                positions.append(position)
                if signal["intel"]:
                    position += 1
                else:
                    position = position + 15 if position % 8 == 0 else position - 1
            if not signal["intel"]:
                positions.reverse()
            if max(positions) // 8 >= length:
                continue
            for number, position in enumerate(positions):
                payload[position // 8] &= ~(1 << position % 8) & 255
                payload[position // 8] |= (raw >> number & 1) << position % 8
            yield bytes(payload)
    # Every value of small multiplexers.
    for signal in message["signals"].values():
        if not any(other["mux"] is not None for other in message["signals"].values()):
            break
        for _ in range(6):
            yield bytes(generator.randrange(4) for _ in range(length))
    # Shorter than the message says.
    for cut in {length // 2, max(0, length - 1)}:
        yield bytes(generator.randrange(256) for _ in range(cut))


def main():
    generator = random.Random(20240611)
    for path in sorted(FOLDER.glob("*.dbc")):
        for file_id, message in read_dbc(path).items():
            if message["length"] > 64:
                continue
            for payload in payloads(message, generator):
                print("frame", path.name, message["name"], payload.hex() or "-")
                for name, signal in message["signals"].items():
                    if not is_selected(message, signal, payload):
                        continue
                    result = decode(signal, payload)
                    if result is not None:
                        print("value", name, result[0], repr(result[1]))


if __name__ == "__main__":
    main()
