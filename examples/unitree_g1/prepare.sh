#!/bin/sh
# Unpacks the model of the Unitree G1 (29 joints) beside this file, from the wheel `mjlab`: the
# one named, or else pip downloads it.
#
#   examples/unitree_g1/prepare.sh [mjlab-1.6.0-py3-none-any.whl]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
python=${PYTHON:-python3}
xmls=mjlab/asset_zoo/robots/unitree_g1/xmls/
"$python" "$here/../unpack_wheel.py" "${1:-mjlab==1.6.0}" $xmls "$here/model"
"$python" - "$here/model/g1.xml" <<'PYTHON'
import pathlib, re, sys

# Rotors as the wheel's own constants have them (.0036 and .0043 kg·m²), seen through the gears.
# Servos this slow need no finer steps, and nothing of this arm touches anything that is modelled.
model = pathlib.Path(sys.argv[1])
text = model.read_text()
text = text.replace('<default class="g1">', '<default class="g1">\n      <joint armature="0.004"/>', 1)
option = '<option timestep="0.005" integrator="implicitfast"><flag contact="disable"/></option>'
text = text.replace("<default>", option + "\n\n  <default>", 1)
# Its hands are other ones than the model's: a camera had better see none than wrong ones.
text, hands = re.subn(r'<geom [^>]*mesh="(left|right)_rubber_hand"[^>]*/>', "", text)
assert hands == 2, "another version of the model"
model.write_text(text)
PYTHON
echo "$here/model/g1.xml"
