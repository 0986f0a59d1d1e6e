#!/usr/bin/env bash
# Two joints of one body are one joint "Composite_…" in Pinocchio; the name of the second is gone.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 pin==4.1.0
cat > "$folder/model.xml" <<'XML'
<mujoco>
  <worldbody>
    <body name="b"><joint name="pan" axis="0 0 1"/><joint name="tilt" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body>
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
print("Pinocchio", *list(other.names)[1:], "with", other.nq, "positions")
print("named:", other.existJointName("pan"), other.existJointName("tilt"))
PYTHON
"$folder/venv/bin/python" "$folder/read.py" "$folder/model.xml" | tee "$folder/seen"
echo "mujoco 4.0.0, pin 4.1.0"
echo "guess: two joints with their names, a massless body between them"
echo "seen:  one joint, found by neither name"
printf 'MuJoCo pan tilt\nPinocchio Composite_pan with 2 positions\nnamed: False False\n' | cmp - "$folder/seen"
