#!/usr/bin/env bash
# Pinocchio takes `ref` from the limits of a joint, though its positions count from there as in MuJoCo.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 pin==4.1.0
cat > "$folder/model.xml" <<'XML'
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="b"><joint name="j" axis="0 1 0" range="-1 2" ref="0.5"/><geom size="0.1" pos="0.2 0 0"/></body>
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
data.qpos[:] = 0.2
mujoco.mj_forward(one, data)
pin.framesForwardKinematics(other, mine, data.qpos)
where = mine.oMf[other.getFrameId("b")] * np.array([0.2, 0.0, 0.0])
print("place at 0.2 rad:", "the same" if np.allclose(where, data.geom_xpos[0]) else where)
print("MuJoCo", *one.jnt_range[0])
print("Pinocchio", other.lowerPositionLimit[0], other.upperPositionLimit[0])
PYTHON
"$folder/venv/bin/python" "$folder/read.py" "$folder/model.xml" | tee "$folder/seen"
echo "mujoco 4.0.0, pin 4.1.0"
echo "guess: either both are moved by ref, or neither"
echo "seen:  at the same position the body is at the same place; the limits differ by ref"
printf 'place at 0.2 rad: the same\nMuJoCo -1.0 2.0\nPinocchio -1.5 1.5\n' | cmp - "$folder/seen"
