#!/usr/bin/env bash
# MuJoCo: with the default cone, a box of friction 0.5 slides down a slope of 20 degrees along the diagonal
# of its contact frame, as with 0.35, and not along an axis; with cone="elliptic" it holds in both.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 numpy==2.4.6
cat > "$folder/try.py" <<'PYTHON'
import math

import mujoco

BOX = """<mujoco><option gravity="{} {} {}" {}/><worldbody><geom type="plane" size="9 9 1" friction="0.5"/>
<body pos="0 0 0.1"><freejoint/><geom type="box" size="0.2 0.2 0.1" friction="0.5"/></body></worldbody></mujoco>"""


def slides(slope_deg, towards_deg, cone):
    """Return whether a box moves by more than 5 cm within 2 s on a slope; gravity is tilted for it."""
    slope, towards = math.radians(slope_deg), math.radians(towards_deg)
    down = 9.81 * math.sin(slope)
    text = BOX.format(down * math.cos(towards), down * math.sin(towards), -9.81 * math.cos(slope), cone)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    while data.time < 2.0:
        mujoco.mj_step(model, data)
    return math.hypot(*data.qpos[:2]) > 0.05


for cone in ("", 'cone="elliptic"'):
    for towards in (0, 45):
        least = next(deg for deg in range(15, 35) if slides(deg, towards, cone))
        print(cone or "default cone", f"towards {towards} degrees: slides from {least} degrees on")
PYTHON
"$folder/venv/bin/python" "$folder/try.py" | tee "$folder/seen"
echo "mujoco 4.0.0: a box of friction 0.5 on a plane of 0.5; atan(0.5) = 26.6 degrees"
echo "guess: it slides from 27 degrees on, whichever way the slope goes"
echo "seen:  towards the diagonal of the pyramid that stands for the cone, from 20 degrees on"
cat > "$folder/expected" <<'END'
default cone towards 0 degrees: slides from 27 degrees on
default cone towards 45 degrees: slides from 20 degrees on
cone="elliptic" towards 0 degrees: slides from 27 degrees on
cone="elliptic" towards 45 degrees: slides from 27 degrees on
END
cmp "$folder/expected" "$folder/seen"
