#!/usr/bin/python3
"""What tools/with-vcan promises, checked from outside.

WITH_VCAN_INIT names the guest's init (ctest sets it). The first line says which backend is in use. Its promises are
then checked once more for the native backend with a stand-in for ip(8), so that its code runs even where the kernel
has no CAN. Script and init are copied to a world-readable place, so that the test of another user does not depend on
who may read the tree.
"""
import contextlib
import fcntl
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
NOBODY = 65534
PATIENCE_S = 60  # for anything that must end; only a defect makes a test wait that long
PYTHON = ("/usr/bin/python3", "-IS", "-c")

place = None  # the world-readable folder of this run


def copy_init(source, folder):
    """The guest's init, and what is preloaded into linux.uml on newer processors, which is found beside it."""
    shutil.copy(source, f"{folder}/vcan-init")
    shutil.copy(os.path.join(os.path.dirname(os.path.realpath(source)), "vcan-uml-xstate.so"), folder)


def setUpModule():
    global place
    place = tempfile.mkdtemp(prefix="with-vcan-test.")
    os.chmod(place, 0o755)
    os.mkdir(f"{place}/tools")
    os.mkdir(f"{place}/stand-in")
    shutil.copy(f"{ROOT}/tools/with-vcan", f"{place}/tools/with-vcan")
    copy_init(os.environ["WITH_VCAN_INIT"], place)
    for name in ("tmp", "work"):
        os.mkdir(f"{place}/{name}")
        os.chmod(f"{place}/{name}", 0o1777)
    with open(f"{place}/stand-in/ip", "w") as file:
        file.write('#!/bin/sh\ncase "$*" in "link add vcan"*|"link set vcan"*) exit 0;; esac\n'
                   f'exec {shutil.which("ip", path="/usr/sbin:/usr/bin:/sbin:/bin")} "$@"\n')
    os.chmod(f"{place}/stand-in/ip", 0o755)


def tearDownModule():
    shutil.rmtree(place)


def default_signals():
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGPIPE):
        signal.signal(number, signal.SIG_DFL)


def job_folders():
    return [name for name in os.listdir(f"{place}/tmp") if name.startswith("with-vcan.")]


def process_state(pid):
    """Returns (parent, state, start time), or None when the process is gone; a zombie is gone."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            fields = file.read().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return None
    return None if fields[0] in "ZX" else (int(fields[1]), fields[0], fields[19])


def tree_of(ancestor):
    """Returns {pid: start time} of a process and all below it."""
    states = {int(entry): process_state(entry) for entry in os.listdir("/proc") if entry.isdigit()}
    found, size = {ancestor}, 0
    while len(found) > size:
        size = len(found)
        found |= {pid for pid, state in states.items() if state and state[0] in found}
    return {pid: states[pid][2] for pid in found if states.get(pid)}


def still_alive(tree):
    return [pid for pid, start in tree.items() if (state := process_state(pid)) and state[2] == start]


def marked_processes(marker):
    """Returns the pids of all processes with the marker in their arguments or environment."""
    found = []
    for entry in filter(str.isdigit, os.listdir("/proc")):
        for name in ("cmdline", "environ"):
            with contextlib.suppress(OSError), open(f"/proc/{entry}/{name}", "rb") as file:
                if marker.encode() in file.read():
                    found.append(int(entry))
    return sorted(set(found) - {os.getpid()})


def comes_true(claim, within_s):
    end = time.monotonic() + within_s
    while not claim():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


class WithVcan(unittest.TestCase):
    """How to call with-vcan; the properties are below."""

    options = ()
    path_prefix = ""

    def setUp(self):
        self.work = tempfile.mkdtemp(dir=f"{place}/work")
        os.chmod(self.work, 0o777)
        self.user = ()

    def tearDown(self):
        self.assertEqual(job_folders(), [], "a job folder was left behind")

    def environment(self, **more):
        kept = {name: value for name, value in os.environ.items() if name not in ("WITH_VCAN", "WITH_VCAN_RAMDIR")}
        path = self.path_prefix + kept.get("PATH", os.defpath) + ":/usr/sbin:/sbin"
        return {**kept, "PATH": path, "TMPDIR": f"{place}/tmp", "WITH_VCAN_INIT": f"{place}/vcan-init", **more}

    def start(self, *arguments, **settings):
        settings = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "cwd": self.work,
                    "env": self.environment(), "preexec_fn": default_signals, **settings}
        process = subprocess.Popen([*self.user, f"{place}/tools/with-vcan", *self.options, *arguments], **settings)
        self.addCleanup(self.finish, process)
        return process

    @staticmethod
    def finish(process):
        if process.poll() is None:
            process.kill()
        process.wait()
        for stream in (process.stdin, process.stdout, process.stderr):
            if stream:
                stream.close()

    def run_it(self, *arguments, input=None, **settings):
        """Returns (exit code, standard output, standard error)."""
        if input is not None:
            settings["stdin"] = subprocess.PIPE
        process = self.start(*arguments, **settings)
        out, err = process.communicate(input, timeout=PATIENCE_S)
        return process.returncode, out, err

    def expect(self, arguments, code, out=b"", err=b"", **settings):
        self.assertEqual(self.run_it(*arguments, **settings), (code, out, err))

    def expect_refusal(self, arguments, *words, **settings):
        code, out, err = self.run_it(*arguments, **settings)
        text = err.decode()
        self.assertEqual((code, out), (125, b""), text)
        self.assertTrue(text.startswith("with-vcan: "), text)
        for word in words:
            self.assertIn(word, text)


class Properties:
    """What holds for every backend. Mixed into a WithVcan with the backend's options."""

    # ---- exit codes

    def test_the_exit_code_is_the_commands_own(self):
        for code in (0, 3):
            with self.subTest(code=code):
                self.expect(["--", "sh", "-c", f"exit {code}"], code)

    def test_a_command_that_is_not_found_gives_127(self):
        self.expect(["--", "no-such-command"], 127, err=b"with-vcan: no-such-command: command not found\n")

    def test_a_command_that_cannot_be_executed_gives_126(self):
        self.expect(["--", "/etc/passwd"], 126, err=b"with-vcan: /etc/passwd: Permission denied\n")

    def test_a_command_ended_by_signal_9_gives_137(self):
        self.expect(["--", "sh", "-c", "kill -KILL $$"], 137)

    def test_a_script_without_a_first_line_runs_as_in_a_shell(self):
        with open(f"{self.work}/script", "w") as file:
            file.write('echo "$1"; exit 4\n')
        os.chmod(f"{self.work}/script", 0o755)
        self.expect(["./script", "text"], 4, b"text\n")

    # ---- output and input

    def test_standard_output_and_standard_error_stay_apart(self):
        self.expect(["--", "sh", "-c", "echo out; echo err >&2"], 0, b"out\n", b"err\n")

    def test_output_arrives_while_the_command_runs(self):
        process = self.start("--", "sh", "-c", "echo first; sleep 1; echo last")
        self.assertEqual(process.stdout.readline(), b"first\n")
        first_at = time.monotonic()
        self.assertEqual(process.stdout.readline(), b"last\n")
        self.assertGreater(time.monotonic() - first_at, 0.7)
        self.assertEqual(process.wait(PATIENCE_S), 0)

    def test_five_megabytes_of_any_bytes_arrive_intact(self):
        data = os.urandom(5_000_000)
        with open(f"{self.work}/data", "wb") as file:
            file.write(data)
        code, out, err = self.run_it("--", "cat", "data")
        self.assertEqual((code, err), (0, b""))
        self.assertTrue(out == data, f"{len(out)} bytes of {len(data)}, or other bytes")

    def test_a_slow_reader_loses_nothing(self):
        process = self.start("--", "seq", "100000")
        time.sleep(1.5)
        out, _ = process.communicate(timeout=PATIENCE_S)
        self.assertEqual(out.split(), [b"%d" % i for i in range(1, 100001)])

    def test_a_reader_that_leaves_ends_the_writer(self):
        process = self.start("--", "yes")
        self.assertEqual(process.stdout.readline(), b"y\n")
        process.stdout.close()
        self.assertEqual(process.wait(PATIENCE_S), 128 + signal.SIGPIPE)

    def test_standard_input_is_carried_in_on_request(self):
        data = bytes(range(256)) * 400
        self.expect(["--stdin", "--", "cat"], 0, data, input=data)

    def test_standard_input_is_empty_otherwise(self):
        self.expect(["--", "cat"], 0, input=b"not for the command\n")

    def test_standard_input_arrives_line_by_line(self):
        process = self.start("--stdin", "--", "sed", "-u", "s/^/> /", stdin=subprocess.PIPE)
        for line in (b"one\n", b"two\n"):
            process.stdin.write(line)
            process.stdin.flush()
            self.assertEqual(process.stdout.readline(), b"> " + line)
        process.stdin.close()
        self.assertEqual(process.wait(PATIENCE_S), 0)

    def test_a_closed_standard_input_output_or_error_does_no_harm(self):
        script = f"{place}/tools/with-vcan"
        inner = " ".join([script, *self.options, "--", "sh", "-c", "'echo out; exit 5'"])
        done = subprocess.run(["sh", "-c", f"{inner} <&- 2>&-"], env=self.environment(), stdout=subprocess.PIPE,
                              timeout=PATIENCE_S)
        self.assertEqual((done.returncode, done.stdout), (5, b"out\n"))

    # ---- signals and time

    def start_and_await_ready(self, *arguments):
        process = self.start(*arguments)
        self.assertEqual(process.stdout.readline(), b"ready\n")
        return process

    def expect_clean_stop(self, number, code):
        name = signal.Signals(number).name[3:]
        script = f"trap 'echo caught {name} > caught; exit {code}' {name}; echo ready; while :; do sleep 0.05; done"
        process = self.start_and_await_ready("--", "sh", "-c", script)
        sent_at = time.monotonic()
        process.send_signal(number)
        self.assertEqual(process.wait(PATIENCE_S), code)
        self.assertLess(time.monotonic() - sent_at, 5, "the command was told too late")
        with open(f"{self.work}/caught") as file:
            self.assertEqual(file.read(), f"caught {name}\n")

    def test_sigint_lets_the_command_stop_cleanly(self):
        self.expect_clean_stop(signal.SIGINT, 130)

    def test_sigterm_lets_the_command_stop_cleanly(self):
        self.expect_clean_stop(signal.SIGTERM, 7)

    def test_sighup_lets_the_command_stop_cleanly(self):
        self.expect_clean_stop(signal.SIGHUP, 0)

    def test_a_signal_that_the_command_does_not_catch_ends_it(self):
        with open(f"{self.work}/word", "w") as file:
            file.write("ready\n")
        # no shell: dash loses one SIGINT in five that comes just before it executes its last command
        process = self.start_and_await_ready("--", "tail", "-f", "word")
        process.send_signal(signal.SIGINT)
        self.assertEqual(process.wait(PATIENCE_S), 128 + signal.SIGINT)

    def test_a_signal_that_comes_before_the_command_starts_is_not_lost(self):
        process = self.start("--", "sleep", "60")
        self.assertTrue(comes_true(lambda: self.catches(process.pid, signal.SIGTERM), PATIENCE_S))
        process.send_signal(signal.SIGTERM)
        self.assertEqual(process.wait(PATIENCE_S), 128 + signal.SIGTERM)

    @staticmethod
    def catches(pid, number):
        with open(f"/proc/{pid}/status") as file:
            caught = next(line for line in file if line.startswith("SigCgt:"))
        return int(caught.split()[1], 16) >> (number - 1) & 1

    def test_a_command_that_ignores_sigterm_is_killed_after_the_grace_period(self):
        script = "trap '' TERM; echo ready; while :; do sleep 1; done"
        process = self.start_and_await_ready("--grace", "0.3", "--", "sh", "-c", script)
        process.send_signal(signal.SIGTERM)
        self.assertEqual(process.wait(PATIENCE_S), 137)

    def test_the_time_limit_ends_the_command_with_124(self):
        began_at = time.monotonic()
        self.expect(["-t", "0.5", "--", "sleep", "60"], 124)
        self.assertLess(time.monotonic() - began_at, 30)

    def test_the_time_limit_asks_before_it_kills(self):
        script = "trap 'echo asked; exit 0' TERM; while :; do :; done"
        self.expect(["-t", "0.5", "--", "sh", "-c", script], 124, b"asked\n")

    def test_the_time_limit_kills_a_command_that_does_not_listen(self):
        self.expect(["-t", "0.3", "--grace", "0.3", "--", "sh", "-c", "trap '' TERM; while :; do sleep 1; done"], 124)

    def test_the_time_limit_holds_even_if_nobody_reads_the_output(self):
        process = self.start("-t", "0.5", "--grace", "0.2", "--", "yes")
        self.assertEqual(process.wait(PATIENCE_S), 124)

    def test_a_command_within_its_time_limit_is_left_alone(self):
        self.expect(["-t", "60", "--", "echo", "done"], 0, b"done\n")

    # ---- where the command runs

    def test_the_current_directory_is_the_callers(self):
        folder = os.fsencode(self.work) + b"/a b\n\xc3\xa4\xff"
        os.mkdir(folder)
        self.expect(["--", "/bin/pwd"], 0, folder + b"\n", cwd=folder)

    def test_the_environment_is_the_callers_and_with_vcan(self):
        mine = {b"PATH": os.fsencode(self.environment()["PATH"]), b"TMPDIR": os.fsencode(f"{place}/tmp"),
                b"WITH_VCAN_INIT": os.fsencode(f"{place}/vcan-init"),
                b"EMPTY": b"", b"LINES": b"a\nb\n", b"EQUALS": b"a=b=", b"QUOTES": b"'\"$`\\ ",
                b"BYTES": b"\xff\x01\xc3\xa4", b"odd-name.1": b"x", b"LONG": b"l" * 100_000}
        code, out, err = self.run_it("--", "env", "-0", env=mine)
        self.assertEqual((code, err), (0, b""))
        pairs = [entry.partition(b"=") for entry in out.split(b"\0") if entry]
        self.assertEqual(sorted((name, value) for name, _, value in pairs),
                         sorted({**mine, b"WITH_VCAN": self.backend.encode()}.items()))

    def test_the_arguments_are_the_callers(self):
        odd = [b"", b"a b", b"--help", b"-t", b"a\nb", b"'\"$`\\", b"\xff\xc3\xa4"]
        self.expect(["--", "printf", "%s|", *odd], 0, b"".join(argument + b"|" for argument in odd))

    def test_files_are_made_with_the_callers_mask(self):
        script = "touch made; umask 002; touch open"
        self.expect(["--", "sh", "-c", script], 0, preexec_fn=lambda: os.umask(0o027))
        self.assertEqual(os.stat(f"{self.work}/made").st_mode & 0o777, 0o640)
        self.assertEqual(os.stat(f"{self.work}/open").st_mode & 0o777, 0o664)

    def test_multicast_on_loopback_reaches_a_member_of_the_group(self):
        self.expect(["--", *PYTHON, """
import socket, struct
group, port = "239.255.76.67", 7667
receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
receiver.bind((group, port))
receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(group) + struct.pack("=I", 0))
receiver.settimeout(5)
sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
sender.sendto(b"hello", (group, port))
print(receiver.recv(100).decode())
"""], 0, b"hello\n")

    def test_nested_use_just_executes_the_command(self):
        outside = self.run_it("--", f"{place}/tools/with-vcan", "--which")
        self.assertEqual(outside, (0, self.backend.encode() + b"\n", b""))

    def test_verbose_names_the_backend_on_standard_error(self):
        code, out, err = self.run_it("--verbose", "--", "true")
        self.assertEqual((code, out), (0, b""))
        self.assertRegex(err.decode(), rf"^with-vcan: {self.backend}\b.*, ready in \d+\.\d\d s\n$")

    # ---- what is left

    def test_what_the_command_leaves_running_ends_with_it(self):
        marker = os.path.basename(self.work)
        began_at = time.monotonic()
        stubborn = f"trap '' TERM; : > deaf; while :; do sleep 1; done; : {marker}"
        script = 'sh -c "$0" & until [ -e deaf ]; do sleep 0.02; done; echo up'
        self.expect(["--", "sh", "-c", script, stubborn], 0, b"up\n")
        self.assertLess(time.monotonic() - began_at, 30)
        self.assertEqual(marked_processes(marker), [])

    def expect_nothing_left_after_kill(self, process):
        tree = tree_of(process.pid)
        self.assertGreaterEqual(len(tree), 3, "expected the wrapper, its guardian and the cell")
        process.kill()
        process.wait(PATIENCE_S)
        self.assertTrue(comes_true(lambda: not still_alive(tree), 10), f"still alive: {still_alive(tree)}")
        self.assertTrue(comes_true(lambda: not job_folders(), 10), f"left behind: {job_folders()}")
        return tree

    def test_sigkill_of_the_wrapper_leaves_nothing(self):
        marker = os.path.basename(self.work)
        script = f"sleep 60 & setsid sleep 60 & echo ready; while :; do :; done; : {marker}"
        process = self.start_and_await_ready("--", "sh", "-c", script)
        self.assertNotEqual(marked_processes(marker), [])
        self.expect_nothing_left_after_kill(process)
        self.assertEqual(marked_processes(marker), [])

    def test_two_at_once_do_not_interfere(self):
        script = "for i in $(seq 20); do echo {0}; sleep 0.02; done; exit {0}"
        both = [self.start("--", "sh", "-c", script.format(i)) for i in (1, 2)]
        for i, process in enumerate(both, start=1):
            out, err = process.communicate(timeout=PATIENCE_S)
            self.assertEqual((process.returncode, out, err), (i, b"%d\n" % i * 20, b""))

    def test_another_user_than_root_can_use_it(self):
        if os.geteuid() == 0:
            self.user = ("setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups")
        expected = NOBODY if os.geteuid() == 0 else os.geteuid()
        self.expect(["--", "sh", "-c", "id -u; : > made; exit 6"], 6, b"%d\n" % expected)
        self.assertEqual(os.stat(f"{self.work}/made").st_uid, expected)
        process = self.start_and_await_ready("--", "sh", "-c", "setsid sleep 60 & echo ready; while :; do :; done")
        self.expect_nothing_left_after_kill(process)


class InUse(Properties, WithVcan):
    """The backend that this machine uses."""

    backend = ""

    def test_frames_travel_between_can_utils(self):
        script = ("candump -L -n 1 vcan0 & dump=$!\n"
                  "while kill -0 $dump 2>/dev/null; do cansend vcan0 123#DEADBEEF; sleep 0.05; done; wait $dump")
        code, out, err = self.run_it("-t", "20", "--", "sh", "-c", script)
        self.assertEqual((code, err), (0, b""))
        self.assertRegex(out.decode(), r"^\(\d+\.\d+\) vcan0 123#DEADBEEF( \w)?\n$")

    def test_a_flexible_data_rate_frame_travels(self):
        script = ("candump -L -n 1 vcan0 & dump=$!\n"
                  f"while kill -0 $dump 2>/dev/null; do cansend vcan0 123##1{'11' * 64}; sleep 0.05; done; wait $dump")
        code, out, _ = self.run_it("-t", "20", "--", "sh", "-c", script)
        self.assertEqual(code, 0)
        self.assertRegex(out.decode(), r" vcan0 123##[0-9A-F]" + "11" * 64)

    def test_two_at_once_have_each_their_own_bus(self):
        script = ("candump -L -n 10 vcan0 & dump=$!\n"
                  "while kill -0 $dump 2>/dev/null; do cansend vcan0 {0}#{0}0; sleep 0.02; done; wait $dump")
        both = [self.start("-t", "30", "--", "sh", "-c", script.format(name)) for name in ("111", "222")]
        outputs = [process.communicate(timeout=PATIENCE_S)[0].decode() for process in both]
        self.assertEqual([process.returncode for process in both], [0, 0])
        self.assertEqual((outputs[0].count("111#"), outputs[0].count("222#")), (10, 0))
        self.assertEqual((outputs[1].count("222#"), outputs[1].count("111#")), (10, 0))

    def test_interfaces_have_the_names_asked_for(self):
        code, out, _ = self.run_it("-i", "can_a", "-i", "can-b", "--", "ip", "-brief", "link")
        self.assertEqual(code, 0)
        self.assertEqual([line.split()[0] for line in out.decode().splitlines()], ["lo", "can_a", "can-b"])

    def test_nested_use_sees_the_outer_interfaces(self):
        inner = f"{place}/tools/with-vcan"
        self.expect(["--", inner, "--", "sh", "-c", 'cansend vcan0 123#; exit 9'], 9)
        code, out, err = self.run_it("--", inner, "--iface", "vcan7", "--", "true")
        self.assertEqual((code, out), (125, b""))
        self.assertIn(b"add --iface vcan7 to the outer with-vcan", err)


class InUserModeLinux(WithVcan):
    """What concerns the guest alone."""

    options = ("--backend", "uml")

    def test_socket_buffers_and_real_time_priority_are_unlocked(self):
        code, out, err = self.run_it("--", *PYTHON, """
import resource, socket
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
    s.setsockopt(socket.SOL_SOCKET, option, 8 << 20)
    print(s.getsockopt(socket.SOL_SOCKET, option))
print(resource.getrlimit(resource.RLIMIT_RTPRIO)[0], resource.getrlimit(resource.RLIMIT_MEMLOCK)[0])
""")
        self.assertEqual((code, out.split(), err), (0, [b"%d" % (16 << 20)] * 2 + [b"99", b"-1"], b""))

    def test_a_further_module_is_loaded_with_what_it_needs(self):
        code, out, _ = self.run_it("--module", "can-gw", "--", "cat", "/proc/modules")
        self.assertEqual(code, 0)
        self.assertIn(b"can_gw ", out)

    def test_the_job_folder_is_gone_once_the_command_runs(self):
        process = self.start("--", "sh", "-c", "echo ready; sleep 60")
        self.assertEqual(process.stdout.readline(), b"ready\n")
        self.assertTrue(comes_true(lambda: not job_folders(), 10))
        process.send_signal(signal.SIGTERM)
        process.wait(PATIENCE_S)

    def test_sigkill_during_boot_leaves_nothing(self):
        process = self.start("--", "sleep", "60")
        self.assertTrue(comes_true(job_folders, 30))
        self.assertTrue(comes_true(lambda: len(tree_of(process.pid)) >= 3, 30))
        Properties.expect_nothing_left_after_kill(self, process)

    def test_sigkill_of_the_guardian_ends_the_guest(self):
        process = self.start("--", "sh", "-c", "echo ready; while :; do :; done")
        self.assertEqual(process.stdout.readline(), b"ready\n")
        tree = tree_of(process.pid)
        guardian, = [pid for pid in tree if (process_state(pid) or [0])[0] == process.pid]
        os.kill(guardian, signal.SIGKILL)
        self.assertEqual(process.wait(PATIENCE_S), 125)
        if os.geteuid() == 0:  # others have no PID namespace
            self.assertTrue(comes_true(lambda: not still_alive(tree), 10), f"still alive: {still_alive(tree)}")
        self.assertIn(b"ended without a result", process.stderr.read())

    def test_a_job_folder_without_an_owner_is_removed_at_the_next_start(self):
        for name in ("stale", "owned"):
            os.mkdir(f"{place}/tmp/with-vcan.{name}")
            open(f"{place}/tmp/with-vcan.{name}/lock", "w").close()
        with open(f"{place}/tmp/with-vcan.owned/lock") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            self.expect(["--", "true"], 0)
            self.assertEqual(job_folders(), ["with-vcan.owned"])
        self.expect(["--", "true"], 0)

    def test_output_that_cannot_be_written_is_an_error(self):
        with open("/dev/full", "w") as full:
            code, _, err = self.run_it("--", "echo", "lost", stdout=full)
        text = b"with-vcan: cannot write to descriptor 1: No space left on device; output was lost\n"
        self.assertEqual((code, err), (125, text))

    def test_a_path_with_spaces_is_no_obstacle(self):
        folder = f"{self.work}/a b"
        os.mkdir(folder)
        copy_init(f"{place}/vcan-init", folder)
        self.expect(["--init", f"{folder}/vcan-init", "--", "echo", "ok"], 0, b"ok\n")

    def test_a_guest_that_dies_is_reported_with_its_console(self):
        self.expect_refusal(["--init", "/bin/false", "--", "true"], "ended without a result", "console", "Kernel panic")

    def test_a_directory_that_the_guest_lacks_is_named(self):
        folder = tempfile.mkdtemp(dir="/dev/shm")
        self.addCleanup(os.rmdir, folder)
        self.expect_refusal(["--", "true"], f"cannot enter the current directory {folder}", cwd=folder)


class Refusals(WithVcan):
    """Errors that are found before anything is started say what, where, what was expected, what to type."""

    def test_no_command(self):
        self.expect_refusal([], "no command", "with-vcan -- ip -brief link")
        self.expect_refusal(["--"], "no command")

    def test_an_unknown_option(self):
        self.expect_refusal(["--bogus", "--", "true"], "--bogus", "expected `with-vcan", "--help")

    def test_an_unknown_backend(self):
        self.expect_refusal(["--backend", "qemu", "--", "true"], "qemu", "auto", "native", "uml")

    def test_a_time_limit_that_is_no_number(self):
        self.expect_refusal(["-t", "soon", "--", "true"], "-t", "soon")

    def test_an_impossible_interface_name(self):
        for name in ("a/b", "", "lo", "sixteen-letters.", "a b"):
            with self.subTest(name=name):
                self.expect_refusal([f"--iface={name}", "--", "true"], f"--iface {name!r}", "expected 1 to 15")
        self.expect_refusal(["-i", "vcan1", "-i", "vcan1", "--", "true"], "--iface vcan1", "expected once")

    def test_a_cpu_that_is_not_ours(self):
        self.expect_refusal(["--cpu", "9999", "--", "true"], "--cpu 9999", "expected auto, none or one of")

    def test_too_little_guest_memory(self):
        self.expect_refusal(["--mem", "8", "--", "true"], "--mem 8", "at least 32")

    def test_no_room_for_guest_memory(self):
        self.expect_refusal(["--backend", "uml", "--mem", "99000000", "--", "true"],
                            "no room for guest RAM", "MB free", "--mem 128")

    def test_an_unknown_module(self):
        self.expect_refusal(["--backend", "uml", "--module", "no-such", "--", "true"], "--module no-such", "can-gw")

    def test_a_missing_init(self):
        environment = self.environment(WITH_VCAN_INIT="/no/such/init")
        self.expect_refusal(["--backend", "uml", "--", "true"], "no executable file /no/such/init",
                            "cmake --build --preset release --target vcan_init", env=environment)
        del environment["WITH_VCAN_INIT"]
        self.expect_refusal(["--backend", "uml", "--", "true"], f"{place}/build/*/bin/vcan-init",
                            "cmake --build --preset release --target vcan_init", env=environment)

    def test_a_missing_user_mode_linux(self):
        self.expect_refusal(["--backend", "uml", "--", "true"], "no linux.uml in PATH",
                            "apt-get install user-mode-linux", env=self.environment(PATH="/nowhere"))

    def test_inside_without_being_inside(self):
        self.expect_refusal(["--iface", "vcan77", "--", "true"], "WITH_VCAN=uml", "vcan77 does not exist",
                            "unset WITH_VCAN", env=self.environment(WITH_VCAN="uml"))

    def test_help_and_version_are_not_errors(self):
        for option, word in (("--help", b"Exit status"), ("--version", b"with-vcan ")):
            code, out, err = self.run_it(option)
            self.assertEqual((code, err), (0, b""))
            self.assertIn(word, out)

    def test_the_newest_init_of_the_build_folders_is_found(self):
        for age, name in enumerate(("new", "old")):
            os.makedirs(f"{place}/build/{name}/bin")
            copy_init(f"{place}/vcan-init", f"{place}/build/{name}/bin")
            if name == "old":
                shutil.copy("/bin/false", f"{place}/build/{name}/bin/vcan-init")
            os.utime(f"{place}/build/{name}/bin/vcan-init", (1e9 - age, 1e9 - age))
        self.addCleanup(shutil.rmtree, f"{place}/build")
        environment = self.environment()
        del environment["WITH_VCAN_INIT"]
        self.expect(["--backend", "uml", "--", "echo", "ok"], 0, b"ok\n", env=environment)


class NativeWithStandIn(Properties, WithVcan):
    """The native backend's own code, with an ip(8) that only pretends to make vcan interfaces."""

    backend = "native"
    options = ("--backend", "native")

    def setUp(self):
        super().setUp()
        self.path_prefix = f"{place}/stand-in:"

    def test_the_real_ip_names_what_the_kernel_lacks(self):
        if in_use == "native":
            return  # nothing is lacking: InUse covers it
        self.path_prefix = ""
        self.expect_refusal(["--", "true"], "`ip link add vcan0 type vcan` failed", "Unknown device type")

    def test_the_command_is_in_namespaces_of_its_own(self):
        code, out, _ = self.run_it("--", "sh", "-c", "echo $$; ip -brief link | wc -l")
        pid, link_count = map(int, out.split())
        self.assertEqual((code, link_count), (0, 1))
        self.assertLess(pid, 100, "expected the small number of a young PID namespace")


def namespaces_are_allowed():
    """Returns whether this user may make the namespaces of the native backend."""
    user = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    command = ["unshare", "--net", "--pid", "--mount", "--fork", *user, "true"]
    return subprocess.run(command, capture_output=True).returncode == 0


def backend_in_use():
    environment = {name: value for name, value in os.environ.items() if name != "WITH_VCAN"}
    asked = subprocess.run([f"{ROOT}/tools/with-vcan", "--which"], capture_output=True, text=True, env=environment)
    if asked.returncode != 0:
        sys.exit(asked.stderr)
    return asked.stdout.strip()


if __name__ == "__main__":
    if not os.access(os.environ.get("WITH_VCAN_INIT", ""), os.X_OK):
        sys.exit("WITH_VCAN_INIT must name the built vcan-init; "
                 "type: cmake --build --preset release --target vcan_init")
    in_use = backend_in_use()
    InUse.backend = in_use
    print(f"backend in use: {in_use}", flush=True)
    if not namespaces_are_allowed():
        print("the native backend is NOT checked: this user may not make namespaces here", flush=True)
        del NativeWithStandIn
    unittest.main(verbosity=2)
