#!/bin/sh
# Unpacks the model of the Unitree G1 (29 joints) beside this file, from the wheel `mjlab`.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
python=${PYTHON:-python3}
wheels=$(mktemp -d)
trap 'rm -rf "$wheels"' EXIT
"$python" -m pip download --quiet --no-deps --dest "$wheels" mjlab==1.6.0
"$python" - "$wheels"/mjlab-*.whl "$here/model" <<'PYTHON'
import pathlib, sys, zipfile

wheel, target = zipfile.ZipFile(sys.argv[1]), pathlib.Path(sys.argv[2])
prefix = "mjlab/asset_zoo/robots/unitree_g1/xmls/"
for name in wheel.namelist():
    if name.startswith(prefix) and not name.endswith("/"):
        path = target / name.removeprefix(prefix)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(wheel.read(name))

# Rotors as the wheel's own constants have them (.0036 and .0043 kg·m²), seen through the gears.
# Servos this slow need no finer steps, and nothing of this arm touches anything that is modelled.
model = target / "g1.xml"
text = model.read_text()
text = text.replace('<default class="g1">', '<default class="g1">\n      <joint armature="0.004"/>', 1)
option = '<option timestep="0.005" integrator="implicitfast"><flag contact="disable"/></option>'
model.write_text(text.replace("<default>", option + "\n\n  <default>", 1))
PYTHON
echo "$here/model/g1.xml"
