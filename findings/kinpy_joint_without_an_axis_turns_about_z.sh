#!/usr/bin/env bash
# kinpy: a joint of a URDF without <axis> turns about z; the specification says x, and so do yourdfpy and Pinocchio.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet kinpy==0.6.1 yourdfpy==0.0.60 pin==4.1.0
cat > "$folder/try.py" <<'PYTHON'
import kinpy
import pinocchio
import yourdfpy

ROBOT = """<robot name="robot"><link name="base"/><link name="arm"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
with open("robot.urdf", "w") as file:
    file.write(ROBOT)
chain = kinpy.build_chain_from_urdf(ROBOT)
print("kinpy", *(int(value) for value in chain._root.children[0].joint.axis))
print("yourdfpy", *(int(value) for value in yourdfpy.URDF.load("robot.urdf").robot.joints[0].axis))
print("pin", pinocchio.buildModelFromXML(ROBOT).joints[1].shortname())
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "kinpy 0.6.1, yourdfpy 0.0.60, pin 4.1.0: a revolute joint without <axis>"
echo "guess: x of all three"
echo "seen:  z of kinpy"
printf 'kinpy 0 0 1\nyourdfpy 1 0 0\npin JointModelRX\n' | cmp - "$folder/seen"
