#!/usr/bin/env bash
# ./run.sh mjlab RUN, or ./run.sh playground RUN: train in the worlds that a run of
# `simtune tune cartpole` found possible, as far as to show that each environment has one of them.
# The library gets an environment of its own here, of one to three gigabytes.
set -euo pipefail
library=${1:?mjlab or playground}
run=$(realpath "${2:?the folder of a run of simtune tune cartpole}")
cd "$(dirname "${BASH_SOURCE[0]}")"

if [ ! -e ".venv-$library/ready" ]; then
    python3 -m venv ".venv-$library"
    ".venv-$library/bin/pip" install --quiet --requirement "$library.txt"
    touch ".venv-$library/ready"
fi
worlds=$(mktemp -d)
trap 'rm -rf "$worlds"' EXIT
simtune export "$run" --out "$worlds" --samples 200 --format "$library"
PYTHONPATH=$worlds ".venv-$library/bin/python" "${library}_cartpole.py" "$worlds/worlds.npz"
