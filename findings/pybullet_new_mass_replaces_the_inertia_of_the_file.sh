#!/usr/bin/env bash
# PyBullet: changeDynamics(mass=…) with the mass that a link has already replaces the inertia of its URDF by that of its shape.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pybullet==3.2.7 numpy==2.4.6
cat > "$folder/robot.urdf" <<'XML'
<robot name="r">
 <link name="shaped">
  <inertial><mass value="2"/><inertia ixx="0.3" iyy="0.2" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><box size="1 2 3"/></geometry></collision>
 </link>
 <link name="bare">
  <inertial><mass value="2"/><inertia ixx="0.3" iyy="0.2" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
 </link>
 <joint name="j" type="continuous">
  <parent link="shaped"/><child link="bare"/><axis xyz="0 0 1"/>
 </joint>
</robot>
XML
cat > "$folder/try.py" <<'PYTHON'
import pybullet

pybullet.connect(pybullet.DIRECT)
robot = pybullet.loadURDF("robot.urdf", flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
for link in (-1, 0):
    before = pybullet.getDynamicsInfo(robot, link)[2]
    pybullet.changeDynamics(robot, link, mass=2.0)
    after = pybullet.getDynamicsInfo(robot, link)[2]
    print(*(f"{value:.3g}" for value in (*before, *after)))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr | grep -v '^pybullet build') | tee "$folder/seen"
echo "PyBullet 3.2.7: moments of inertia before, and after a change of the mass from 2 kg to 2 kg"
echo "guess: they stay, or scale with the mass: 0.3 0.2 0.1 again"
echo "seen:  those of the box of 1 x 2 x 3 m; of a link without a shape a millionth"
printf '0.3 0.2 0.1 2.17 1.67 0.833\n0.3 0.2 0.1 1.33e-06 1.33e-06 1.33e-06\n' | cmp - "$folder/seen"
