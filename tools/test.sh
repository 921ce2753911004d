#!/usr/bin/env bash
# Runs every test: sets up the machine, builds the release preset, runs ctest. The tests on a real CAN
# bus run inside tools/with-vcan; the run says on which backend.
#   tools/test.sh               every test
#   tools/test.sh --sanitize    before that, those that need no CAN under the address and
#                               undefined-behaviour sanitizers (preset asan)
set -euo pipefail
cd "$(dirname "$0")/.."

presets=(release)
case "${1:-}" in
  "") ;;
  --sanitize) presets=(asan release) ;;
  -h | --help) sed -n '2,6s/^# \{0,1\}//p' "$0"; exit 0 ;;
  *) printf "test: found option '%s', expected --sanitize or --help\n" "$1" >&2; exit 2 ;;
esac

tools/setup.sh
status=0
for preset in "${presets[@]}"; do
  printf 'test: building preset %s\n' "$preset"
  cmake --preset "$preset" >/dev/null
  cmake --build --preset "$preset" -- --quiet
  printf 'test: running preset %s\n' "$preset"
  [ "$preset" != release ] || printf 'test: the CAN bus is %s\n' "$(tools/with-vcan --which)"
  ctest --test-dir "build/$preset" --output-on-failure --no-tests=error -j "$(nproc)" --progress ||
    status=1
done
exit "$status"
