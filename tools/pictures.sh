#!/usr/bin/env bash
# Makes the pictures of the README from runs of the examples: docs/pictures/report.png, scorecard.png, and dash.png from a
# bench on vcan.
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
FAULTLINE=$program "$root/examples/scorecard.sh" "$work/scorecard.html" >/dev/null 2>&1
# The table of all banks, and the servo drive's charts.
sed -i 's|</head>|<style>main>section:not(:first-child),main>h2{display:none!important}main>h2.last,main>section.last{display:block!important}section.last .scroll{display:none}</style></head>|;
  s|<h2 class="group">jin|<h2 class="group last">jin|' "$work/scorecard.html"
python3 - "$work/scorecard.html" <<'END'
import sys
text = open(sys.argv[1], encoding="utf-8").read()
at = text.index("<h3>Faults</h3>", text.index('class="group last"'))
at = text.rindex("<section>", 0, at)
open(sys.argv[1], "w", encoding="utf-8").write(text[:at] + '<section class="last">' + text[at + len("<section>"):])
END
chromium --headless=new --no-sandbox --disable-gpu --hide-scrollbars --user-data-dir="$work/profile" \
  --window-size=1250,1120 --virtual-time-budget=8000 --screenshot="$out/scorecard.png" "file://$work/scorecard.html" 2>/dev/null
FAULTLINE=$program WITH_VCAN_INIT=${WITH_VCAN_INIT:-$(dirname "$program")/vcan-init} DASH_PICTURES=$work \
  python3 "$root/tests/tools/dash_page_test.py"
cp "$work/dash.png" "$out/dash.png"
echo "pictures: $out/report.png $out/scorecard.png $out/dash.png"
