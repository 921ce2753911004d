#!/usr/bin/env bash
# Makes one page with the figures of Ma, Gao, Guo (2024), from runs of the scenarios here, and beside each what the paper
# claims and what is true.
#   examples/ma2024/figures.sh [OUT.html]     default: ./ma2024-figures.html; FAULTLINE names the program
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
program=${FAULTLINE:-$here/../../build/release/bin/faultline}
out=${1:-ma2024-figures.html}
logs=$(mktemp -d)
trap 'rm -rf "$logs"' EXIT
"$program" run --quiet --log-dir "$logs" "$here"/fig*.toml
"$program" report "$logs" --figures "$here/figures/figures.toml" -o "$out"
echo "figures: $out"
