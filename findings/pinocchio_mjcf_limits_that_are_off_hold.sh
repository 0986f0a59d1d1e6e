#!/usr/bin/env bash
# Pinocchio limits a joint with limited="false", and locks one with the range 0 0, which MuJoCo reads as none.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 pin==4.1.0
cat > "$folder/model.xml" <<'XML'
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="a"><joint name="off" axis="0 1 0" range="-1 2" limited="false"/><geom size="0.1" pos="0.2 0 0"/>
      <body name="b"><joint name="zero" axis="0 1 0" range="0 0"/><geom size="0.1" pos="0.2 0 0"/></body>
    </body>
  </worldbody>
</mujoco>
XML
cat > "$folder/read.py" <<'PYTHON'
import sys
import mujoco, numpy as np, pinocchio as pin

path = sys.argv[1]
one = mujoco.MjModel.from_xml_path(path)
other = pin.buildModelFromMJCF(path)
print("limited in MuJoCo:", *(bool(value) for value in one.jnt_limited))
for name in ("off", "zero"):
    at = other.idx_qs[other.getJointId(name)]
    print(name, other.lowerPositionLimit[at], other.upperPositionLimit[at])
PYTHON
"$folder/venv/bin/python" "$folder/read.py" "$folder/model.xml" | tee "$folder/seen"
echo "mujoco 4.0.0, pin 4.1.0"
echo "guess: no limits in both"
echo "seen:  MuJoCo has none; Pinocchio has -1 to 2, and 0 to 0"
printf 'limited in MuJoCo: False False\noff -1.0 2.0\nzero 0.0 0.0\n' | cmp - "$folder/seen"
