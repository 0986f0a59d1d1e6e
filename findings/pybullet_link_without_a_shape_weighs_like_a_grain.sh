#!/usr/bin/env bash
# PyBullet: loadURDF takes a link's inertia from its collision shape; a link without a shape, whose file says 1 kg m2, has that of a cube of 2 mm, and 24 Nm throw it to its velocity limit in one step.
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
for name, flags in (("default", 0), ("from file", pybullet.URDF_USE_INERTIA_FROM_FILE)):
    pybullet.resetSimulation()
    robot = pybullet.loadURDF("robot.urdf", useFixedBase=True, flags=flags)
    pybullet.setJointMotorControl2(robot, 0, pybullet.VELOCITY_CONTROL, force=0)
    pybullet.setJointMotorControl2(robot, 0, pybullet.TORQUE_CONTROL, force=24)
    pybullet.stepSimulation()
    mass, _, inertia = pybullet.getDynamicsInfo(robot, 0)[:3]
    print(f"{name}: {mass} kg, inertia {inertia[0]:.1e}, {pybullet.getJointState(robot, 0)[1]:.2f} rad/s")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | grep -v "build time" | tee "$folder/seen"
echo "pybullet 3.2.7: 24 Nm for a step of 1/240 s on a link of 1 kg and 1 kg m2 without a collision shape; loaded by default and with URDF_USE_INERTIA_FROM_FILE"
echo "guess: 0.10 rad/s both times, or an error where there is nothing to compute an inertia from"
echo "seen:  6.7e-07 kg m2 and 100 rad/s by default, its velocity limit; 0.10 rad/s with the flag"
printf 'default: 1.0 kg, inertia 6.7e-07, 100.00 rad/s\nfrom file: 1.0 kg, inertia 1.0e+00, 0.10 rad/s\n' | cmp - "$folder/seen"
