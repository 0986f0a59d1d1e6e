#!/usr/bin/env bash
# Pinocchio: forwardKinematics takes the quaternion of a free base as it is: of length 2, its rotation has the determinant 12; MuJoCo normalises it.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pin==4.1.0 mujoco==4.0.0
cat > "$folder/run.py" <<'PYTHON'
import sys
from math import cos, sin

import mujoco
import numpy as np
import pinocchio as pin

w, z = 2 * cos(0.5), 2 * sin(0.5)
model = pin.Model()
model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
data = model.createData()
pin.forwardKinematics(model, data, np.array([0, 0, 0, 0, 0, z, w]))
theirs = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
)
other = mujoco.MjData(theirs)
other.qpos[3:] = [w, 0, 0, z]
mujoco.mj_kinematics(theirs, other)
with open(sys.argv[1], "w") as seen:
    print(f"pinocchio: determinant {np.linalg.det(data.oMi[1].rotation):.2f}", file=seen)
    print(f"mujoco: determinant {np.linalg.det(other.xmat[1].reshape(3, 3)):.2f}", file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "pin 4.1.0, mujoco 4.0.0"
echo "guess: both normalise it, or one refuses it: a rotation has the determinant 1"
echo "seen:"
cat seen
printf 'pinocchio: determinant 12.03\nmujoco: determinant 1.00\n' | cmp - seen
