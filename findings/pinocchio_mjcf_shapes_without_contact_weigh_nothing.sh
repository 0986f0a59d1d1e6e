#!/usr/bin/env bash
# A geom with contype="0" and conaffinity="0" has a mass in MuJoCo, even one that is given, and none in Pinocchio.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 pin==4.1.0
cat > "$folder/model.xml" <<'XML'
<mujoco>
  <worldbody>
    <body name="b"><joint name="j" axis="0 1 0"/>
      <geom size="0.1" mass="1"/>
      <geom type="box" size="0.1 0.1 0.1" mass="2" contype="0" conaffinity="0"/>
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
print("MuJoCo", one.body_mass[1], "kg")
print("Pinocchio", pin.computeTotalMass(other), "kg")
PYTHON
"$folder/venv/bin/python" "$folder/read.py" "$folder/model.xml" | tee "$folder/seen"
echo "mujoco 4.0.0, pin 4.1.0"
echo "guess: what collides and what weighs are two matters: 3 kg in both"
echo "seen:  3 kg in MuJoCo, 1 kg in Pinocchio"
printf 'MuJoCo 3.0 kg\nPinocchio 1.0 kg\n' | cmp - "$folder/seen"
