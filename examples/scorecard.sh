#!/usr/bin/env bash
# Scores the methods of the three papers on their example plants, an ordinary observer beside each: what each detects, how
# fast, how often wrong. One page.
#   examples/scorecard.sh [OUT.html [RUNS]]    default: ./scorecard.html, as many runs as the sweeps say (1000 to 2000 each)
# FAULTLINE names the program. The databases are kept beside the page, in OUT.html's folder/scorecard-runs: a second call
# goes on where the first was stopped.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
program=${FAULTLINE:-$here/../build/release/bin/faultline}
out=${1:-scorecard.html}
runs=${2:-}
folder=$(dirname "$out")/scorecard-runs
mkdir -p "$folder"
# campaign SWEEP BANK NAME
campaign() {
  local sweep=$here/scorecard/$1_sweep.toml
  if [ -n "$runs" ]; then
    sed -e "s/^runs .*/runs = $runs/" -e "s|^scenario = \"|&$here/scorecard/|" "$sweep" >"$folder/$1_sweep.toml"
    sweep=$folder/$1_sweep.toml
  fi
  # 1: expectations or single runs that failed, which the page shows.
  "$program" campaign "$sweep" --bank "$here/$2" -o "$folder/$3.db" || [ $? -eq 1 ]
}
campaign hou2015 hou2015/thresholds/comparison.toml hou_geometric
campaign hou2015 hou2015/thresholds/cusum.toml hou_geometric_cusum
campaign hou2015 scorecard/hou2015_ordinary.toml hou_ordinary
campaign ma2024 ma2024/bank.toml ma_uio
campaign ma2024 scorecard/ma2024_ordinary.toml ma_ordinary
campaign jin jin/bank.toml jin_eigenstructure
campaign jin jin/bank_ordinary.toml jin_ordinary
cd "$folder"
page=$(basename "$out")
"$program" score hou_geometric.db hou_geometric_cusum.db hou_ordinary.db ma_uio.db ma_ordinary.db \
  jin_eigenstructure.db jin_ordinary.db -o "../$page"
echo "scorecard: $out"
