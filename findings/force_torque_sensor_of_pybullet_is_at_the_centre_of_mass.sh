#!/usr/bin/env bash
# A link of 2 kg whose centre of mass is 0.5 m beyond its joint: MuJoCo's sensors at the joint read 20 N and 10 N m, PyBullet's force-torque sensor of the joint reads 20 N and no torque.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 numpy==2.4.6 pybullet==3.2.7
cat > "$folder/run.py" <<'PYTHON'
import sys
from pathlib import Path

import mujoco
import pybullet as p

Path("robot.urdf").write_text("""<robot name="r"><link name="base"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<link name="tool"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="j" type="fixed"><parent link="base"/><child link="tool"/></joint></robot>""")
p.connect(p.DIRECT)
p.setGravity(0, 0, -10)
body = p.loadURDF("robot.urdf", useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE)
p.enableJointForceTorqueSensor(body, 0, True)
for _ in range(10):
    p.stepSimulation()
ours = p.getJointState(body, 0)[2]
model = mujoco.MjModel.from_xml_string("""<mujoco><option gravity="0 0 -10"/><worldbody><body>
<inertial pos="0.5 0 0" mass="2" diaginertia="1 1 1"/><site name="joint"/></body></worldbody>
<sensor><force site="joint"/><torque site="joint"/></sensor></mujoco>""")
data = mujoco.MjData(model)
mujoco.mj_step(model, data)
with open(sys.argv[1], "w") as seen:
    for name, values in {"pybullet": ours, "mujoco": data.sensordata}.items():
        print(f"{name}:", *(round(value, 3) + 0.0 for value in values), file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "pybullet 3.2.7, mujoco 4.0.0: force and torque in the joint that holds the link"
echo "guess: 0 0 20 0 -10 0 in both"
echo "seen:"
cat seen
cmp - seen <<'SEEN'
pybullet: 0.0 0.0 20.0 0.0 0.0 0.0
mujoco: 0.0 0.0 20.0 0.0 -10.0 0.0
SEEN
