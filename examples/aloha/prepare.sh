#!/bin/sh
# Unpacks the scene of ALOHA (two ViperX arms, a table, a box) beside this file, from the wheel
# `gym-aloha`: the one named, or else pip downloads it.
#
#   examples/aloha/prepare.sh [gym_aloha-0.1.5-py3-none-any.whl]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
python=${PYTHON:-python3}
"$python" "$here/../unpack_wheel.py" "${1:-gym-aloha==0.1.5}" gym_aloha/assets/ "$here/model"
"$python" - "$here/model/bimanual_viperx_transfer_cube.xml" <<'PYTHON'
import pathlib, sys

# Of two that touch MuJoCo takes the larger friction; with priority it takes the box's own.
model = pathlib.Path(sys.argv[1])
text = model.read_text()
assert text.count('name="red_box"') == 1, "another version of the scene"
model.write_text(text.replace('name="red_box"', 'name="red_box" priority="1"'))
PYTHON
echo "$here/model/bimanual_viperx_transfer_cube.xml"
