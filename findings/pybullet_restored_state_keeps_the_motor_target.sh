#!/usr/bin/env bash
# PyBullet: restoreState puts positions and velocities back, and leaves each motor its newest target.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pybullet==3.2.7 numpy==2.4.6
cat > "$folder/try.py" <<'PYTHON'
import pybullet

ROBOT = """<robot name="robot"><link name="base"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link><link name="arm"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1000" velocity="100"/></joint></robot>"""
with open("robot.urdf", "w") as file:
    file.write(ROBOT)
pybullet.connect(pybullet.DIRECT)
robot = pybullet.loadURDF("robot.urdf", useFixedBase=True)


def aim(target):
    pybullet.setJointMotorControl2(robot, 0, pybullet.POSITION_CONTROL, targetPosition=target, force=1000)


aim(0.5)
pybullet.stepSimulation()
saved = pybullet.saveState()
aim(-0.5)
pybullet.restoreState(saved)
for _ in range(200):
    pybullet.stepSimulation()
print(f"joint at {pybullet.getJointState(robot, 0)[0]:.2f}")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "pybullet 3.2.7: target 0.5, saveState, target -0.5, restoreState, 200 steps"
echo "guess: the joint goes to 0.5, its target when it was saved"
echo "seen:  it goes to -0.5"
printf 'joint at -0.50\n' | cmp - "$folder/seen"
