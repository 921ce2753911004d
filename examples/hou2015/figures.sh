#!/usr/bin/env bash
# Makes one page with the figures of Hou, Cheng, Hu, Jin (2015) that show this paper's residuals (3 to 16), from runs of the
# scenarios here, and beside each what the paper claims and what is true.
#   examples/hou2015/figures.sh [OUT.html]     default: ./hou2015-figures.html; FAULTLINE names the program
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
program=${FAULTLINE:-$here/../../build/release/bin/faultline}
out=${1:-hou2015-figures.html}
logs=$(mktemp -d)
trap 'rm -rf "$logs"' EXIT
"$program" run --quiet --log-dir "$logs" "$here"/figures/fig0[34].toml "$here"/fig0[5-9].toml "$here"/fig1[0-6].toml
"$program" report "$logs" --figures "$here/figures/figures.toml" -o "$out"
echo "figures: $out"
