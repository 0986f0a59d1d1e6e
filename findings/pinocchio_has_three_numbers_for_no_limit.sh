#!/usr/bin/env bash
# Pinocchio: a joint without limits has inf, 1.01 or the largest double as its limit; isfinite() finds the first only.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pin==4.1.0
cat > "$folder/limits.py" <<'PYTHON'
import sys
from pathlib import Path
import pinocchio as pin

path = Path(sys.argv[1])
path.write_text('<mujoco><worldbody><body name="b"><joint name="j"/><geom size="0.1"/></body></worldbody></mujoco>')
urdf = '''<robot name="r"><link name="a"/>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint>
<link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'''
print("hinge of an MJCF", pin.buildModelFromMJCF(str(path)).upperPositionLimit[0])
print("continuous joint of a URDF", pin.buildModelFromXML(urdf).upperPositionLimit[0])
floating = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer())
print("base that floats", floating.upperPositionLimit[0])
print("drawn between limits:", pin.randomConfiguration(floating)[0])
PYTHON
"$folder/venv/bin/python" "$folder/limits.py" "$folder/m.xml" | tee "$folder/seen"
echo "pin 4.1.0"
echo "guess: all are inf, and randomConfiguration() raises an error for them, as it once did"
echo "seen:  inf, 1.01 (of a cosine), the largest double; randomConfiguration() returns inf"
cat > "$folder/expected" <<'SEEN'
hinge of an MJCF inf
continuous joint of a URDF 1.01
base that floats 1.7976931348623157e+308
drawn between limits: inf
SEEN
cmp "$folder/expected" "$folder/seen"
