#!/usr/bin/env bash
# PyBullet: after a step, getLinkState gives the pose and velocity before the step, and getJointState those after it, unless computeForwardKinematics=1.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6 pybullet==3.2.7
cat > "$folder/run.py" <<'PYTHON'
import math
import sys
from pathlib import Path

import pybullet as p

Path("robot.urdf").write_text("""<robot name="r"><link name="base"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<link name="arm"><inertial><origin xyz="0.5 0 0"/><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
</robot>""")
p.connect(p.DIRECT)
p.setTimeStep(0.01)
body = p.loadURDF("robot.urdf", useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE)
p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, force=0)
p.changeDynamics(body, 0, linearDamping=0, angularDamping=0)
p.resetJointState(body, 0, 0, 1.0)


def angle(**options):
    """Return the direction of the arm's centre of mass [rad]."""
    x, y, _ = p.getLinkState(body, 0, **options)[0]
    return math.atan2(y, x)


with open(sys.argv[1], "w") as seen:
    for step in (1, 2, 3):
        p.stepSimulation()
        angles = (p.getJointState(body, 0)[0], angle(), angle(computeForwardKinematics=1))
        print(step, *(f"{value:.3f}" for value in angles), file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "pybullet 3.2.7: step, angle of the joint, of its link, of its link with computeForwardKinematics=1 [rad]"
echo "guess: all three are the same in every step"
echo "seen:"
cat seen
printf '1 0.010 0.000 0.010\n2 0.020 0.010 0.020\n3 0.030 0.020 0.030\n' | cmp - seen
