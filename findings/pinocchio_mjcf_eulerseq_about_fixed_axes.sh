#!/usr/bin/env bash
# Pinocchio reads eulerseq="XYZ", about axes that stay, otherwise than MuJoCo; "xyz" alike.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 pin==4.1.0
cat > "$folder/model.xml" <<'XML'
<mujoco>
  <compiler eulerseq="XYZ"/>
  <worldbody>
    <body name="b" euler="30 20 10"><joint name="j" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body>
  </worldbody>
</mujoco>
XML
cat > "$folder/read.py" <<'PYTHON'
import sys
import mujoco, numpy as np, pinocchio as pin

path = sys.argv[1]
one = mujoco.MjModel.from_xml_path(path)
other = pin.buildModelFromMJCF(path)
data, mine = mujoco.MjData(one), other.createData()
mujoco.mj_forward(one, data)
pin.framesForwardKinematics(other, mine, np.zeros(1))
turn = mine.oMf[other.getFrameId("b")].rotation
print("angle between both:", round(float(np.degrees(np.linalg.norm(pin.log3(data.xmat[1].reshape(3, 3).T @ turn)))), 2), "degrees")
PYTHON
"$folder/venv/bin/python" "$folder/read.py" "$folder/model.xml" | tee "$folder/seen"
echo "mujoco 4.0.0, pin 4.1.0"
echo "guess: one of both sequences is a mirror of the other, both readers know both"
echo "seen:  they differ by 12 degrees"
printf 'angle between both: 11.97 degrees\n' | cmp - "$folder/seen"
