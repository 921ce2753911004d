"""A network namespace of a test's own, where nobody else's LCM traffic is."""
import os
import socket
import struct
import sys

URL = "udpm://239.255.76.67:7667?ttl=0"
IN_NAMESPACE = "FAULTLINE_TEST_IN_NAMESPACE"


def enter_namespace(program):
    """Replaces this process by `program`, itself, in a new network namespace with multicast on lo; once."""
    if IN_NAMESPACE in os.environ:
        return
    own = ["--net"] if os.geteuid() == 0 else ["--net", "--map-root-user"]
    set_up = 'ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && exec "$@"'
    os.environ["PATH"] += ":/usr/sbin:/sbin"
    os.execvpe("unshare", ["unshare", *own, "sh", "-c", set_up, "sh", sys.executable, os.path.abspath(program),
                           *sys.argv[1:]], {**os.environ, IN_NAMESPACE: "1"})


def send_probe():
    """Publishes an LCM message (short form: magic, sequence number, channel, payload) on PROBE."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        sender.sendto(struct.pack(">II", 0x4C433032, 0) + b"PROBE\0", ("239.255.76.67", 7667))
