#!/usr/bin/env bash
# Makes the pictures of the README from runs of the examples: docs/pictures/report.png, and dash.png from a bench on vcan.
#   tools/pictures.sh [FOLDER]     default: docs/pictures; FAULTLINE names the program; needs chromium
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
program=${FAULTLINE:-$root/build/release/bin/faultline}
out=${1:-$root/docs/pictures}
mkdir -p "$out"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export HOME=$work XDG_CONFIG_HOME=$work
"$program" run "$root/examples/hou2015/fig15.toml" --quiet --log "$work/run.lcm" --report "$work/report.html" >/dev/null
# Only timeline and residuals: what stands between them would not fit a picture.
sed -i 's|</head>|<style>#metrics,#overview,#window,.scroll,nav{display:none!important}</style></head>|' "$work/report.html"
chromium --headless=new --no-sandbox --disable-gpu --hide-scrollbars --user-data-dir="$work/profile" \
  --window-size=1100,1130 --virtual-time-budget=8000 --screenshot="$out/report.png" "file://$work/report.html" 2>/dev/null
FAULTLINE=$program WITH_VCAN_INIT=${WITH_VCAN_INIT:-$(dirname "$program")/vcan-init} DASH_PICTURES=$work \
  python3 "$root/tests/tools/dash_page_test.py"
cp "$work/dash.png" "$out/dash.png"
echo "pictures: $out/report.png $out/dash.png"
