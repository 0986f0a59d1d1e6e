#!/usr/bin/env bash
# PyBullet: under TORQUE_CONTROL a joint turns by the torque that was given, and getJointState says that the applied torque is 0.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pybullet==3.2.7 numpy==2.4.6
cat > "$folder/try.py" <<'PYTHON'
import pybullet

LINK = '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
with open("robot.urdf", "w") as file:
    file.write('<robot name="robot">' + LINK.format("base") + LINK.format("arm") + '<joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="100" velocity="100"/></joint></robot>')
pybullet.connect(pybullet.DIRECT)
for mode in ("torque", "velocity"):
    pybullet.resetSimulation()
    robot = pybullet.loadURDF("robot.urdf", useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
    pybullet.setJointMotorControl2(robot, 0, pybullet.VELOCITY_CONTROL, force=0)
    if mode == "torque":
        pybullet.setJointMotorControl2(robot, 0, pybullet.TORQUE_CONTROL, force=24)
    else:
        pybullet.setJointMotorControl2(robot, 0, pybullet.VELOCITY_CONTROL, targetVelocity=0.1, force=1000)
    pybullet.stepSimulation()
    _, velocity, _, torque = pybullet.getJointState(robot, 0)
    print(f"{mode}: turns with {velocity:.2f} rad/s, applied torque {torque:.1f} Nm")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | grep -v "build time" | tee "$folder/seen"
echo "pybullet 3.2.7: an arm of 1 kg m2 gets 24 Nm for a step of 1/240 s; another is brought to 0.1 rad/s by its motor"
echo "guess: 0.10 rad/s and an applied torque of 24 Nm both times"
echo "seen:  the torque that a motor needed is reported, one that was commanded reads as 0"
printf 'torque: turns with 0.10 rad/s, applied torque 0.0 Nm\nvelocity: turns with 0.10 rad/s, applied torque 24.0 Nm\n' | cmp - "$folder/seen"
