#!/usr/bin/python3
"""`faultline can dump` and `stats` on real CAN buses: run inside tools/with-vcan -i vcan0 -i vcan1."""
import json
import re
import signal
import subprocess
import unittest

from faultline_program import FolderTest, finish, wait_for

COUNT = 200


class CanBus(FolderTest):
    def listen(self, *arguments):
        """Starts the program and waits until its sockets are open."""
        process = self.folder.start("can", *arguments)
        self.addCleanup(lambda: process.poll() is None and (process.kill(), process.communicate()))
        buses = sum(argument.startswith("can:") for argument in arguments)
        wait_for(lambda: self.raw_sockets() == buses)
        return process

    @staticmethod
    def raw_sockets():
        """CAN_RAW sockets that are bound: the kernel lists a receiver for each."""
        with open("/proc/net/can/rcvlist_all", encoding="ascii") as file:
            return len(re.findall(r"^\s+vcan\d .*\braw$", file.read(), re.MULTILINE))

    @staticmethod
    def send(interface, *frames):
        for frame in frames:
            subprocess.run(["cansend", interface, frame], check=True)

    def test_dump_shows_decoded_frames(self):
        process = self.listen("dump", "can:vcan0", "--dbc", "bench.dbc", "--count", "3")
        self.send("vcan0", "110#102700F0D8FF2A00", "7FF#0102", "7FF#R")
        answer = finish(process)
        self.assert_code(0, answer)
        first, second, third = answer.out.splitlines()
        self.assertRegex(first, r"^\(\d+\.\d{6}\)  vcan0  110 +\[8\]  10 27 00 F0 D8 FF 2A 00  "
                                r"Sensors1  y1=1  y2=-1  Sensors1Cycle=42$")
        self.assertRegex(second, r"vcan0  7FF +\[2\]  01 02 +$")
        self.assertRegex(third, r"vcan0  7FF +\[0\]  remote request +$")
        self.assertIn("received 3, dropped 0, malformed 0", answer.err)

    def test_dump_as_a_log_is_what_candump_writes(self):
        peer = subprocess.Popen(["candump", "-L", "-n", str(COUNT), "vcan0"], stdout=subprocess.PIPE, text=True)
        self.addCleanup(lambda: peer.poll() is None and (peer.kill(), peer.communicate()))
        wait_for(lambda: self.raw_sockets() == 1)
        process = self.folder.start("can", "dump", "can:vcan0", "--format", "log", "--count", str(COUNT))
        wait_for(lambda: self.raw_sockets() == 2)
        subprocess.run(["cangen", "vcan0", "-g", "0", "-n", str(COUNT), "-m", "-e", "-R"], check=False)
        subprocess.run(["cangen", "vcan0", "-g", "0", "-n", str(COUNT), "-f"], check=True)
        want, _ = peer.communicate(timeout=30)
        answer = finish(process)
        self.assert_code(0, answer)
        # candump shows all flag bits of an FD frame that the kernel passes on; FDF says what `##` says.
        want = re.sub(r"##([0-9A-F])", lambda flags: f"##{int(flags[1], 16) & 3:X}", want)
        self.assertEqual(answer.out.splitlines(), want.splitlines())

    def test_several_buses_at_once(self):
        process = self.listen("dump", "can:vcan0", "can:vcan1", "--format", "json", "--count", "2")
        self.send("vcan1", "123#01")
        self.send("vcan0", "124#02")
        answer = finish(process)
        self.assert_code(0, answer)
        frames = [json.loads(line) for line in answer.out.splitlines()]
        self.assertEqual([(frame["bus"], frame["id"]) for frame in frames], [("vcan1", 0x123), ("vcan0", 0x124)])

    def test_ctrl_c_ends_with_what_was_seen(self):
        process = self.listen("stats", "can:vcan0", "--dbc", "bench.dbc", "--json", "-")
        self.send("vcan0", *["110#102700F0D8FF2A00"] * 5, "7FF#00")
        wait_for(lambda: self.has_been_read("vcan0", 6))
        process.send_signal(signal.SIGINT)
        answer = finish(process)
        self.assert_code(0, answer)
        result = json.loads(answer.out)
        self.assertEqual((result["frames"], result["received"], result["dropped"]), (6, 6, 0))
        frames = {entry["message"]: entry["frames"] for entry in result["identifiers"] if entry["frames"]}
        self.assertEqual(frames, {"Sensors1": 5, None: 1})
        self.assertGreater(result["buses"][0]["load"], 0)

    @staticmethod
    def has_been_read(interface, count):
        """All that was sent so far has reached the sockets: there is no queue on a vcan."""
        with open(f"/sys/class/net/{interface}/statistics/rx_packets", encoding="ascii") as file:
            return int(file.read()) >= count

    def test_the_table_has_a_row_per_identifier(self):
        process = self.listen("dump", "can:vcan0", "--dbc", "bench.dbc", "--format", "table", "--count", "7")
        self.send("vcan0", *["110#102700F0D8FF2A00"] * 5, "7FF#0102", "7FF#0203")
        answer = finish(process)
        self.assert_code(0, answer)
        last = answer.out[answer.out.rindex("bus  "):]
        self.assertRegex(last, r"(?m)^vcan0 +110 +5 .*fresh +Sensors1  y1=1  y2=-1")
        self.assertRegex(last, r"(?m)^vcan0 +7FF +2 .*fresh +02 03")
        self.assertRegex(last, r"(?m)^vcan0 +120 +0 .*never seen +$")
        self.assertIn("7 frames, 0 dropped", last)

    def test_a_bench_on_two_buses(self):
        # Commands go over the second bus: the DBC says so.
        self.folder.write("bench.dbc", self.folder.read("bench.dbc").decode() +
                          'BA_DEF_ BO_ "FaultlineBus" INT 0 255;\nBA_DEF_DEF_ "FaultlineBus" 0;\n'
                          'BA_ "FaultlineBus" BO_ 288 1;\nBA_ "FaultlineBus" BO_ 289 1;\n')
        peers = [subprocess.Popen(["candump", "-L", "-T", "2000", interface], stdout=subprocess.PIPE, text=True)
                 for interface in ("vcan0", "vcan1")]
        wait_for(lambda: self.raw_sockets() == 2)
        self.run_ok("run", "demo.toml", "--bus", "can:vcan0,can:vcan1", "--log", "run.lcm")
        seen = [{line.split()[2].partition("#")[0] for line in peer.communicate(timeout=30)[0].splitlines()}
                for peer in peers]
        self.assertEqual(seen, [{"100", "110", "111"}, {"120", "121"}])
        self.run_ok("can", "convert", "run.lcm", "run.log")
        buses = {tuple(line.split()[1:])[0] + " " + line.split()[2].partition("#")[0]
                 for line in self.folder.read("run.log").decode().splitlines()}
        self.assertEqual(buses, {"vcan0 100", "vcan0 110", "vcan0 111", "vcan1 120", "vcan1 121"})

    def test_an_outage_is_told_and_waited_out(self):
        process = self.listen("dump", "can:vcan1", "--format", "log", "--count", "2")
        told = []
        self.send("vcan1", "123#01")
        subprocess.run(["ip", "link", "set", "vcan1", "down"], check=True)
        told.append(process.stderr.readline())
        subprocess.run(["ip", "link", "set", "vcan1", "up"], check=True)
        told.append(process.stderr.readline())
        self.send("vcan1", "124#02")
        answer = finish(process)
        self.assert_code(0, answer)
        self.assertEqual(told, [b"faultline: can:vcan1 is down; waiting for its return\n",
                                b"faultline: can:vcan1 is back\n"])
        self.assertEqual([line.split()[2] for line in answer.out.splitlines()], ["123#01", "124#02"])
        self.assertIn("received 2, dropped 0, malformed 0, outages 1", answer.err)

    def test_error_frames_are_put_into_words(self):
        process = self.listen("dump", "can:vcan0", "--count", "2")
        self.send("vcan0", "20000040#0000000000000000", "20000004#0020000000008000")
        answer = finish(process)
        self.assert_code(0, answer)
        self.assertIn("bus-off", answer.out.splitlines()[0])
        self.assertIn("error-passive", answer.out.splitlines()[1])
        self.assertIn("error frames 2, bus-off 1", answer.err)

    def test_the_doctor_finds_the_buses(self):
        answer = self.folder.run("doctor", "--json", "-")
        found = {entry["check"]: entry for entry in json.loads(answer.out)["checks"]}
        self.assertEqual(found["CAN in the kernel"]["status"], "ok", answer.out)
        self.assertEqual(found["CAN interfaces"]["status"], "ok", answer.out)
        self.assertIn("vcan0, vcan1", found["CAN interfaces"]["found"])

    def test_a_bus_that_is_not_there_is_named(self):
        answer = self.folder.run("can", "dump", "can:vcan7")
        self.assert_code(3, answer)
        self.assertIn("can:vcan7", answer.err)
        self.assertIn("vcan0", answer.err)


if __name__ == "__main__":
    unittest.main()
