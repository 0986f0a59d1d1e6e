#!/usr/bin/env bash
# PyBullet: maxJointVelocity of changeDynamics is given for a joint and holds for all joints of its body; the velocity limit of the URDF holds for none under TORQUE_CONTROL.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6 pybullet==3.2.7
cat > "$folder/run.py" <<'PYTHON'
import sys
from pathlib import Path

import pybullet as p

INERTIAL = """<inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"""
JOINT = """<link name="{0}">{1}</link><joint name="{0}" type="continuous"><parent link="base"/>
<child link="{0}"/><axis xyz="0 0 1"/><limit effort="1000" velocity="10"/></joint>"""
joints = "".join(JOINT.format(name, INERTIAL) for name in ("a", "b"))
Path("robot.urdf").write_text(f'<robot name="r"><link name="base">{INERTIAL}</link>{joints}</robot>')
p.connect(p.DIRECT)
p.setTimeStep(1e-3)


def speeds(limit_of_a):
    """Return what 300 N m make of two joints of 1 kg m2 in a second [rad/s]."""
    p.resetSimulation()
    body = p.loadURDF("robot.urdf", useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE)
    for joint in (0, 1):
        p.setJointMotorControl2(body, joint, p.VELOCITY_CONTROL, force=0)
        p.changeDynamics(body, joint, linearDamping=0, angularDamping=0)
    if limit_of_a:
        p.changeDynamics(body, 0, maxJointVelocity=limit_of_a)
    for _ in range(1000):
        for joint in (0, 1):
            p.setJointMotorControl2(body, joint, p.TORQUE_CONTROL, force=300)
        p.stepSimulation()
    return [round(p.getJointState(body, joint)[1]) for joint in (0, 1)]


with open(sys.argv[1], "w") as seen:
    print("limit 10 of both in the URDF:", *speeds(None), file=seen)
    print("maxJointVelocity=50 of joint 0:", *speeds(50), file=seen)
    print("maxJointVelocity=500 of joint 0:", *speeds(500), file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "pybullet 3.2.7: velocities of two joints that a torque would bring to 300 rad/s"
echo "guess: 10 10, then 50 10, then 300 10"
echo "seen:"
cat seen
cmp - seen <<'SEEN'
limit 10 of both in the URDF: 100 100
maxJointVelocity=50 of joint 0: 50 50
maxJointVelocity=500 of joint 0: 300 300
SEEN
