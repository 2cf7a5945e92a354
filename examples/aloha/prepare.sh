#!/bin/sh
# Unpacks the scene of ALOHA (two ViperX arms, a table, a box) beside this file, from the wheel
# `gym-aloha`: the one named, or else pip downloads it.
#
#   examples/aloha/prepare.sh [gym_aloha-0.1.5-py3-none-any.whl]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
python=${PYTHON:-python3}
wheel=${1:-}
if [ -z "$wheel" ]; then
    wheels=$(mktemp -d)
    trap 'rm -rf "$wheels"' EXIT
    "$python" -m pip download --quiet --no-deps --dest "$wheels" gym-aloha==0.1.5
    wheel=$(echo "$wheels"/gym_aloha-*.whl)
fi
"$python" - "$wheel" "$here/model" <<'PYTHON'
import pathlib, sys, zipfile

wheel, target = zipfile.ZipFile(sys.argv[1]), pathlib.Path(sys.argv[2])
prefix = "gym_aloha/assets/"
for name in wheel.namelist():
    if name.startswith(prefix) and not name.endswith("/"):
        path = target / name.removeprefix(prefix)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(wheel.read(name))

# Of two that touch MuJoCo takes the larger friction; with priority it takes the box's own.
model = target / "bimanual_viperx_transfer_cube.xml"
text = model.read_text()
assert text.count('name="red_box"') == 1, "another version of the scene"
model.write_text(text.replace('name="red_box"', 'name="red_box" priority="1"'))
PYTHON
echo "$here/model/bimanual_viperx_transfer_cube.xml"
