#!/usr/bin/env bash
# Pinocchio takes the axis of `axisangle` with its length: the frame is no rotation then.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 pin==4.1.0
cat > "$folder/model.xml" <<'XML'
<mujoco>
  <worldbody>
    <body name="b" axisangle="0 2 0 30"><joint name="j" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body>
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
for name, turn in (("MuJoCo", data.xmat[1].reshape(3, 3)), ("Pinocchio", mine.oMf[other.getFrameId("b")].rotation)):
    print(name, "determinant", round(float(np.linalg.det(turn)), 3))
PYTHON
"$folder/venv/bin/python" "$folder/read.py" "$folder/model.xml" | tee "$folder/seen"
echo "mujoco 4.0.0, pin 4.1.0"
echo "guess: the axis is a direction, as that of joints and quat are in both"
echo "seen:  the matrix of Pinocchio has another determinant than 1, without an error"
printf 'MuJoCo determinant 1.0\nPinocchio determinant 3.439\n' | cmp - "$folder/seen"
