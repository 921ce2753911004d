#!/usr/bin/env bash
# Watch the bench diagnose two simultaneous actuator faults on a real SocketCAN bus, in real time.
# Sets up the machine, builds the program, runs examples/hou2015/demo.toml on vcan0 (10 s), and
# replays the recorded frames: every residual and verdict must come out the same to the bit.
set -euo pipefail
cd "$(dirname "$0")/.."

log=build/demo.lcm

tools/setup.sh
printf 'demo: building\n'
build_log=$(mktemp)
trap 'rm -f "$build_log"' EXIT
if ! { cmake --preset release && cmake --build --preset release --target faultline vcan_init; } \
  >"$build_log" 2>&1; then
  cat "$build_log" >&2
  printf 'demo: the build failed; what it said is above\n' >&2
  exit 3
fi

printf 'demo: plant, controller and diagnosis on vcan0 (%s); actuators u2 and u3 fail at 4 s\n' \
  "$(tools/with-vcan --which)"
tools/with-vcan -t 120 -- build/release/bin/faultline run examples/hou2015/demo.toml \
  --bus can:vcan0 --realtime --log "$log"

printf '\ndemo: the same once more from the recorded frames\n'
build/release/bin/faultline log check "$log"
build/release/bin/faultline replay "$log" --verify
