"""Runs a libFuzzer program for some seconds on a copy of its seeds; fails if it finds anything.

usage: fuzz_smoke.py [--seconds 60] [--dict FILE] --corpus SEEDS FUZZER

A finding is copied into the working directory as FUZZER-<kind>-<digest>; FUZZER <that file> shows it again.
"""
import argparse
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

# An input may take this long, and the whole program this much memory, sanitizers included.
LONGEST_INPUT_S = 10
MEMORY_MB = 2048


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("fuzzer", type=pathlib.Path)
    parser.add_argument("--corpus", type=pathlib.Path, required=True)
    parser.add_argument("--dict", type=pathlib.Path)
    parser.add_argument("--seconds", type=int, default=60)
    arguments = parser.parse_args()

    seeds = sorted(file for file in arguments.corpus.iterdir() if file.is_file())
    if not seeds:
        return f"{arguments.corpus}: found no seeds, expected at least one"
    with tempfile.TemporaryDirectory(prefix="fuzz_smoke_") as folder:
        found, findings = pathlib.Path(folder, "corpus"), pathlib.Path(folder, "findings")
        found.mkdir()
        findings.mkdir()
        command = [arguments.fuzzer, f"-max_total_time={arguments.seconds}",
                   f"-timeout={LONGEST_INPUT_S}", f"-rss_limit_mb={MEMORY_MB}",
                   f"-artifact_prefix={findings}/", "-print_final_stats=1"]
        if arguments.dict and arguments.dict.exists():
            command.append(f"-dict={arguments.dict}")
        result = subprocess.run(command + [found, arguments.corpus], capture_output=True,
                                text=True, errors="replace")
        for finding in findings.iterdir():
            kept = pathlib.Path(f"{arguments.fuzzer.name}-{finding.name}")
            shutil.copyfile(finding, kept)
            print(f"finding kept: {kept.resolve()}")
    runs = re.search(r"stat::number_of_executed_units:\s*(\d+)", result.stderr)
    if result.returncode != 0 or runs is None:
        print(result.stderr[-20000:])
        return f"{arguments.fuzzer.name}: exit code {result.returncode}"
    count = int(runs.group(1))
    print(f"{arguments.fuzzer.name}: {count} inputs from {len(seeds)} seeds, nothing found")
    # A fuzzer that runs its seeds alone would find nothing either.
    return None if count > 10 * len(seeds) else "hardly any input was tried"


if __name__ == "__main__":
    sys.exit(main())
