#!/usr/bin/env bash
# Pinocchio reads the first body below <worldbody>, and leaves out the others without a word.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 pin==4.1.0
cat > "$folder/model.xml" <<'XML'
<mujoco>
  <worldbody>
    <body name="left"><joint name="l" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body>
    <body name="right" pos="0 1 0"><joint name="r" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body>
  </worldbody>
</mujoco>
XML
cat > "$folder/read.py" <<'PYTHON'
import sys
import mujoco, numpy as np, pinocchio as pin

path = sys.argv[1]
one = mujoco.MjModel.from_xml_path(path)
other = pin.buildModelFromMJCF(path)
print("MuJoCo", *(one.joint(n).name for n in range(one.njnt)))
print("Pinocchio", *list(other.names)[1:])
print("joint r:", other.existJointName("r"), "mass:", round(sum(one.body_mass) / pin.computeTotalMass(other), 9))
PYTHON
"$folder/venv/bin/python" "$folder/read.py" "$folder/model.xml" | tee "$folder/seen"
echo "mujoco 4.0.0, pin 4.1.0"
echo "guess: both have two joints"
echo "seen:  Pinocchio has one joint and half of the mass"
printf 'MuJoCo l r\nPinocchio l\njoint r: False mass: 2.0\n' | cmp - "$folder/seen"
