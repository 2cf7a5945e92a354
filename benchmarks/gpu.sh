#!/usr/bin/env bash
# All that is measured on a GPU, part by part, each within nine minutes:
#
#   benchmarks/gpu.sh OUT [PART ...]       # PYTHON=... for another than .venv/bin/python
#   QUICK=1 DEVICE=cpu benchmarks/gpu.sh OUT   # a rehearsal without a GPU
#
# A part that is done has OUT/PART.txt, whose first line is the commit, the date and the card, and is
# not done again; one that fails leaves OUT/PART.failed.txt, and the next one begins. Long trainings
# go on where they were: their run folders lie in OUT/runs.
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.." || exit 1

out=${1:?a folder for the results}
shift
[ $# -gt 0 ] || set -- doctor tests render agent tune fast paper # right first, then fast
python=${PYTHON:-.venv/bin/python}
device=${DEVICE:-cuda}
quick=${QUICK:+--quick}
limit_s=540
export PYTHONPATH="src${PYTHONPATH:+:$PYTHONPATH}"
mkdir -p "$out/runs"

simtune() { "$python" -m simtune "$@"; }

# What each part runs.
doctor() { simtune doctor; }
tests() { "$python" -m pytest -q -m gpu tests; }
render() { "$python" benchmarks/render.py --device "$device" $quick; }
agent() { "$python" benchmarks/agent.py --device "$device" $quick; }
tune() { "$python" benchmarks/precision.py --tasks ball_in_cup --worlds 1 --minutes 4 $quick; }
fast() { train walker --preset fast --seed 1; }
paper() { train ball_in_cup --preset paper --method oracle; }

train() { # TASK OPTIONS: stopped by the time limit, it goes on in the next call
    if [ -n "$quick" ]; then
        simtune train --help >/dev/null && echo "not trained: QUICK is set"
    else
        simtune train "$@" --device "$device" --out "$out/runs/$1-$3"
    fi
}

card() { nvidia-smi --query-gpu=name --format=csv,noheader 2>/dev/null || echo "no GPU"; }

for part in "$@"; do
    [ -e "$out/$part.txt" ] && continue
    log=$out/$part.failed.txt
    echo "$(git rev-parse --short HEAD) $(date -u +%FT%TZ) $(card)" >"$log"
    began=$SECONDS
    # A shell of its own, so that the limit ends all that the part has started.
    if timeout "$limit_s" bash -c "$(declare -f simtune train "$part"); \
        python=$python device=$device quick=$quick out=$out; $part" >>"$log" 2>&1; then
        mv "$log" "$out/$part.txt"
        echo "$part: $((SECONDS - began)) s; $(tail -n 1 "$out/$part.txt" | cut -c 1-160)"
    else
        echo "$part: failed, or stopped, after $((SECONDS - began)) s; see $log"
    fi
done
