#!/usr/bin/env bash
# urdf-usd-converter: a joint's velocity limit becomes one of its schema in USD, its effort limit an attribute that only this converter names.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet urdf-usd-converter==0.3.4
cat > "$folder/run.py" <<'PYTHON'
import sys

import urdf_usd_converter
from pxr import Usd

MASS = """<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>"""
ROBOT = f"""<robot name="r"><link name="base"/><link name="arm">{MASS}</link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="5" velocity="2"/></joint></robot>"""
with open("r.urdf", "w") as out:
    out.write(ROBOT)
stage = Usd.Stage.Open(urdf_usd_converter.Converter().convert("r.urdf", "out").path)
(joint,) = (prim for prim in stage.Traverse() if prim.GetTypeName() == "PhysicsRevoluteJoint")
names = [a.GetName() for a in joint.GetAttributes() if a.HasAuthoredValue()]
with open(sys.argv[1], "w") as seen:
    print(sorted(n for n in names if "effort" in n.lower() or "velocity" in n.lower()), file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "urdf-usd-converter 0.3.4"
echo "guess: both limits become attributes of the joint's schema, newton:velocityLimit and newton:effortLimit"
echo "seen:"
cat seen
printf "['newton:velocityLimit', 'urdf:limit:effort']\\n" | cmp - seen
