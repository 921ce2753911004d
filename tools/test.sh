#!/usr/bin/env bash
# Runs every test: sets up the machine, builds the release preset, runs ctest. The tests on a real CAN
# bus run inside tools/with-vcan; the run says on which backend. Then the tests that need no CAN once
# more under the address and undefined-behaviour sanitizers.
#   tools/test.sh              everything
#   tools/test.sh --release    without the sanitizers
set -euo pipefail
cd "$(dirname "$0")/.."

presets=(release asan)
case "${1:-}" in
  "") ;;
  --release) presets=(release) ;;
  -h | --help) sed -n '2,6s/^# \{0,1\}//p' "$0"; exit 0 ;;
  *) printf "test: found option '%s', expected --release or --help\n" "$1" >&2; exit 2 ;;
esac

tools/setup.sh
jobs=$(nproc)
for preset in "${presets[@]}"; do
  printf 'test: building preset %s\n' "$preset"
  cmake --preset "$preset" >/dev/null
  cmake --build --preset "$preset" -- --quiet
done
printf 'test: vcan backend: %s\n' "$(tools/with-vcan --which)"
status=0
# The release tests come last: their closing line is the one that counts.
for ((i = ${#presets[@]} - 1; i >= 0; --i)); do
  printf 'test: running preset %s\n' "${presets[i]}"
  ctest --test-dir "build/${presets[i]}" --output-on-failure --no-tests=error -j "$jobs" \
    --progress || status=1
done
exit "$status"
