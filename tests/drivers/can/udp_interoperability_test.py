#!/usr/bin/python3
"""udp: against python-can's udp_multicast, both ways, over IPv4 and IPv6, frame by frame.

Run in a network namespace of its own whose lo carries multicast, with BUS_LINES naming the program
bus_lines.
"""
import unittest

import can

from bus_peers import Reader, as_message, as_text, exchange_with_python_can, random_frames, send

KINDS = ["data", "remote", "fd", "error"]


class UdpInteroperability(unittest.TestCase):
    def test_python_can_and_we_understand_each_other_over_ipv4(self):
        exchange_with_python_can(self, "udp:239.74.163.2:43113", random_frames(500, 1, KINDS),
                                 interface="udp_multicast", channel="239.74.163.2", port=43113, fd=True)

    def test_python_can_and_we_understand_each_other_over_ipv6(self):
        group = "ff15:7079:7468:6f6e:6465:6d6f:6d63:6173"
        exchange_with_python_can(self, f"udp:[{group}]:43113", random_frames(500, 2, KINDS),
                                 interface="udp_multicast", channel=group, port=43113, fd=True)

    def test_a_named_channel_and_a_listener_without_fd_do_not_matter(self):
        reader = Reader("udp:239.74.163.2:43114", 1)
        with can.Bus(interface="udp_multicast", channel="239.74.163.2", port=43114, fd=False) as peer:
            message = as_message("123#0102")
            message.channel = "a long name of a channel " * 10
            peer.send(message)
            self.assertEqual(reader.frames(), ["123#0102"])
            self.assertEqual(as_text(peer.recv(10.0)), "123#0102")  # it hears itself
            send("udp:239.74.163.2:43114", ["123##1AA", "124#03"])
            texts = []
            while not texts:
                received = peer.recv(10.0)
                if received:
                    texts.append(as_text(received))
            self.assertEqual(texts, ["124#03"])

    def test_we_hear_every_frame_of_several_senders_once(self):
        texts = random_frames(200, 3)
        reader = Reader("udp:239.74.163.2:43115", 2 * len(texts))
        with can.Bus(interface="udp_multicast", channel="239.74.163.2", port=43115, fd=True) as peer:
            for text in texts:
                peer.send(as_message(text))
            send("udp:239.74.163.2:43115", texts)
            self.assertEqual(sorted(reader.frames()), sorted(texts + texts))
            self.assertIn("dropped 0 malformed 0", reader.counters)


if __name__ == "__main__":
    unittest.main(verbosity=2)
