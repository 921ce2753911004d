#!/usr/bin/env python3
"""Makes cases.txt: payloads before and after protection, by a slow implementation of the specification.

Written from AUTOSAR's "Specification of CRC Routines" and "E2E Protocol Specification" (profiles 1, 2 and 5), bit by
bit and call by call as those documents describe it; shares nothing with the code under test. Before it writes, it
checks itself against vectors that others published (see README.md).
"""
import os
import random

CASES_PER_PROFILE = 60


def crc_bits(width, polynomial, register, data):
    top, mask = 1 << (width - 1), (1 << width) - 1
    for byte in data:
        for bit in range(7, -1, -1):
            feedback = bool(register & top) ^ bool(byte >> bit & 1)
            register = register << 1 & mask
            if feedback:
                register ^= polynomial
    return register


def routine(width, polynomial, initial, xor):
    """Crc_CalculateCRC*(data, start value, is first call) of the Specification of CRC Routines."""
    def calculate(data, start_value, is_first_call):
        register = initial if is_first_call else start_value ^ xor
        return crc_bits(width, polynomial, register, data) ^ xor
    return calculate


crc8 = routine(8, 0x1D, 0xFF, 0xFF)
crc8_h2f = routine(8, 0x2F, 0xFF, 0xFF)
crc16 = routine(16, 0x1021, 0xFFFF, 0x0000)


def without(payload, first, count):
    return bytes(payload[:first]), bytes(payload[first + count:])


def profile_1(payload, crc_byte, data_id, counter, mode):
    low, high = data_id & 0xFF, data_id >> 8
    if mode == "A":
        crc = crc8([low], 0xFF, False)
        crc = crc8([high], crc, False)
    elif mode == "B":
        crc = crc8([low if counter % 2 == 0 else high], 0xFF, False)
    else:
        crc = crc8([low], 0xFF, False)
        crc = crc8([0], crc, False)
    before, after = without(payload, crc_byte, 1)
    crc = crc8(before, crc, False)
    crc = crc8(after, crc, False)
    return crc ^ 0xFF


def profile_2(payload, crc_byte, data_ids, counter):
    before, after = without(payload, crc_byte, 1)
    crc = crc8_h2f(before + after, 0xFF, True)
    return crc8_h2f([data_ids[counter]], crc, False)


def profile_5(payload, crc_byte, data_id):
    before, after = without(payload, crc_byte, 2)
    crc = crc16(before, 0xFFFF, True)
    crc = crc16(after, crc, False)
    return crc16([data_id & 0xFF, data_id >> 8], crc, False)


def j1850(payload, crc_byte):
    before, after = without(payload, crc_byte, 1)
    return crc8(before + after, 0, True)


def put_nibble(payload, start_bit, value):
    shift = start_bit % 8
    byte = start_bit // 8
    payload[byte] = payload[byte] & ~(0xF << shift) | value << shift


def protect(case, payload):
    payload = bytearray(payload)
    profile, crc_byte, counter, data_id = case["profile"], case["crc_byte"], case["counter"], case["data_id"]
    if profile == "E2E_P05":
        payload[case["alive_bit"] // 8] = counter
    elif case["alive_bit"] >= 0:
        put_nibble(payload, case["alive_bit"], counter)
    if profile == "E2E_P01C":
        put_nibble(payload, case["nibble_bit"], data_id >> 8)
    if profile.startswith("E2E_P01"):
        payload[crc_byte] = profile_1(payload, crc_byte, data_id, counter, profile[-1])
    elif profile == "E2E_P02":
        payload[crc_byte] = profile_2(payload, crc_byte, case["data_ids"], counter)
    elif profile == "E2E_P05":
        crc = profile_5(payload, crc_byte, data_id)
        payload[crc_byte:crc_byte + 2] = [crc & 0xFF, crc >> 8]
    else:
        payload[crc_byte] = j1850(payload, crc_byte)
    return bytes(payload)


def check_self():
    digits = b"123456789"
    assert crc8(digits, 0, True) == 0x4B and crc8_h2f(digits, 0, True) == 0xDF and crc16(digits, 0, True) == 0x29B1
    one = {"crc_byte": 0, "alive_bit": 8, "nibble_bit": 12, "data_id": 0x123}
    published = [("E2E_P01A", 0, "cc00"), ("E2E_P01A", 1, "9101"), ("E2E_P01B", 0, "ce00"), ("E2E_P01B", 1, "0201"),
                 ("E2E_P01C", 0, "2a10"), ("E2E_P01C", 1, "7711")]
    for profile, counter, first in published:
        found = protect({**one, "profile": profile, "counter": counter}, bytes(8))
        assert found.hex() == first + "00" * 6, (profile, counter, found.hex())
    two = {"profile": "E2E_P02", "crc_byte": 0, "alive_bit": 8, "data_id": 0}
    assert protect({**two, "counter": 1, "data_ids": bytes(16)}, bytes(8)).hex() == "4501" + "00" * 6
    for counter, expected in (1, "6101020304050607"), (2, "bc02020304050607"):
        data = bytes([0, 0, *range(2, 8)])
        assert protect({**two, "counter": counter, "data_ids": bytes(range(16))}, data).hex() == expected
    five = {"profile": "E2E_P05", "data_id": 0x1234}
    for length, at, counter, expected in [(8, 0, 0, "1cca00"), (8, 0, 1, "cf8d01"), (16, 8, 0, "289100"),
                                          (16, 8, 1, "fbd601")]:
        case = {**five, "crc_byte": at, "alive_bit": 8 * (at + 2), "counter": counter}
        assert protect(case, bytes(length)).hex() == "00" * at + expected + "00" * (length - at - 3)


def random_case(draw, profile):
    length = draw.choice([3, 4, 8, 8, 8, 12, 16, 24, 32, 48, 64] if profile == "E2E_P05" else
                         [2, 3, 8, 8, 8, 12, 20, 64])
    crc_size = 2 if profile == "E2E_P05" else 1
    crc_byte = draw.randrange(length - crc_size + 1)
    other_bytes = [n for n in range(length) if not crc_byte <= n < crc_byte + crc_size]
    nibbles = [8 * byte + shift for byte in other_bytes for shift in (0, 4)]
    draw.shuffle(nibbles)
    counts = {"E2E_P02": 16, "E2E_P05": 256}.get(profile, 15)
    case = {"profile": profile, "length": length, "crc_byte": crc_byte, "alive_bit": nibbles[0],
            "nibble_bit": nibbles[1] if profile == "E2E_P01C" else -1, "counter": draw.randrange(counts),
            "data_id": 0, "data_ids": bytes(16)}
    if profile == "E2E_P05":
        case["alive_bit"] = 8 * draw.choice(other_bytes)
    if profile == "J1850":
        case["alive_bit"], case["counter"] = -1, 0
    elif profile == "E2E_P02":
        case["data_ids"] = draw.randbytes(16)
    else:
        case["data_id"] = draw.randrange(0x1000 if profile == "E2E_P01C" else 0x10000)
    return case


def main():
    check_self()
    draw = random.Random(4)
    lines = ["# profile length crc_byte alive_bit nibble_bit data_id data_ids counter payload protected; -1: none"]
    for profile in "J1850", "E2E_P01A", "E2E_P01B", "E2E_P01C", "E2E_P02", "E2E_P05":
        for _ in range(CASES_PER_PROFILE):
            case = random_case(draw, profile)
            payload = draw.randbytes(case["length"])
            lines.append(" ".join(str(case[key]) for key in ("profile", "length", "crc_byte", "alive_bit", "nibble_bit",
                                                             "data_id")) +
                         f" {case['data_ids'].hex()} {case['counter']} {payload.hex()} {protect(case, payload).hex()}")
    with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "cases.txt"), "w") as file:
        file.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
