#!/usr/bin/env bash
# Pinocchio keeps an inertia that no body can have where <compiler balanceinertia> lets MuJoCo change it; settotalmass and inertiagrouprange are not read either.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 pin==4.1.0
cat > "$folder/model.xml" <<'XML'
<mujoco>
  <compiler balanceinertia="true" inertiagrouprange="0 1"/>
  <worldbody>
    <body name="a"><joint name="j" axis="0 1 0"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 3"/>
      <body name="b"><joint name="k" axis="0 1 0"/><geom size="0.1" mass="1"/><geom size="0.2" mass="4" group="2"/></body>
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
print("MuJoCo", *one.body_inertia[1].round(4), "mass of b", one.body_mass[2])
print("Pinocchio", *other.inertias[1].inertia.diagonal(), "mass of b", other.inertias[2].mass)
PYTHON
"$folder/venv/bin/python" "$folder/read.py" "$folder/model.xml" | tee "$folder/seen"
echo "mujoco 4.0.0, pin 4.1.0"
echo "guess: compiler options that change masses are read, or refused"
echo "seen:  they are ignored"
printf 'MuJoCo 1.6667 1.6667 1.6667 mass of b 1.0\nPinocchio 1.0 1.0 3.0 mass of b 5.0\n' | cmp - "$folder/seen"
