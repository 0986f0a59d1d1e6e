#!/usr/bin/env bash
# PyBullet: loadURDF(globalScaling=2) doubles lengths, also strokes of prismatic joints; mass and effort stay as they are.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pybullet==3.2.7 numpy==2.4.6
cat > "$folder/robot.urdf" <<'XML'
<robot name="r">
 <link name="base">
  <inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
 </link>
 <link name="slide">
  <inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
 </link>
 <joint name="j" type="prismatic">
  <parent link="base"/><child link="slide"/><origin xyz="0 0 1"/><axis xyz="1 0 0"/>
  <limit lower="-1" upper="1" effort="5" velocity="3"/>
 </joint>
</robot>
XML
cat > "$folder/try.py" <<'PYTHON'
import pybullet

pybullet.connect(pybullet.DIRECT)
robot = pybullet.loadURDF("robot.urdf", globalScaling=2)
mass = pybullet.getDynamicsInfo(robot, 0)[0]
height = pybullet.getLinkState(robot, 0)[0][2]
print("mass", mass, "height", height, "stroke, effort, velocity", *pybullet.getJointInfo(robot, 0)[9:12])
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr | grep -v '^pybullet build') | tee "$folder/seen"
echo "PyBullet 3.2.7"
echo "guess: a robot of twice the size of the same material weighs eight times as much: mass 16"
echo "seen:  mass 2: what was made of metal weighs as much as foam; the stroke is doubled, effort and velocity are not"
printf 'mass 2.0 height 2.0 stroke, effort, velocity 2.0 5.0 3.0\n' | cmp - "$folder/seen"
