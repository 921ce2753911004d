"""Makes python_can_frames.txt, the frames that udp_frame_test.cpp checks against: what python-can
itself writes for a udp_multicast datagram. Run by hand with Debian's python3-can 4.1.0 and
python3-msgpack 1.0.3:

    /usr/bin/python3 tests/drivers/can/python_can_frames.py > tests/drivers/can/python_can_frames.txt
"""
from can import Message
from can.interfaces.udp_multicast.utils import pack_message

STANDARD = {"is_extended_id": False}
FRAMES = [
    # The frame as a line of a candump log, and as python-can has it.
    ("(1436509052.249713) py 123#11223344",
     Message(timestamp=1436509052.249713, arbitration_id=0x123, data=[0x11, 0x22, 0x33, 0x44], **STANDARD)),
    ("(0000000000.000000) py 1ABCDEF0#01", Message(arbitration_id=0x1ABCDEF0, data=[1])),
    ("(0000000000.000000) py 00000000#", Message()),
    ("(0000000000.500000) py 07F#R8",
     Message(timestamp=0.5, arbitration_id=0x7F, is_remote_frame=True, dlc=8, **STANDARD)),
    ("(0000000000.000000) py 7FF##3" + bytes(range(64)).hex().upper(),
     Message(arbitration_id=0x7FF, is_fd=True, bitrate_switch=True, error_state_indicator=True,
             data=bytes(range(64)), **STANDARD)),
    ("(0000000000.000000) py 0000FFFF##0" + "A5" * 12,
     Message(arbitration_id=0xFFFF, is_fd=True, data=b"\xa5" * 12)),
    ("(0000000000.000000) py 20000080#0000000000000000",
     Message(arbitration_id=0x80, is_error_frame=True, data=bytes(8), **STANDARD)),
    ("(0000000000.000000) py 20010000#0000000000000000",
     Message(arbitration_id=0x10000, is_error_frame=True, data=bytes(8))),
]

print("# Made by python_can_frames.py: a candump line, and the datagram that python-can makes of it.")
for line, message in FRAMES:
    print(f"{line} | {pack_message(message).hex()}")
