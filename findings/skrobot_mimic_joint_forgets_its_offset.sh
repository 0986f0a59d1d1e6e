#!/usr/bin/env bash
# scikit-robot: a mimic joint of a URDF follows with its multiplier, and its offset is left out: with
# multiplier 2 and offset 0.1, a leader at 0.5 rad has a follower at 1.0. urchin and Pinocchio say 1.1.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet scikit-robot==0.4.7 urchin==0.0.30 pin==4.1.0
"$folder/venv/bin/python" - "$folder/fingers.urdf" 2>/dev/null <<'PYTHON'
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pinocchio as pin
import skrobot
import urchin

INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
LIMIT = '<axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="9" velocity="9"/>'
URDF = (
    '<robot name="fingers">'
    + "".join(f'<link name="{name}">{INERTIAL}</link>' for name in ("palm", "one", "two"))
    + f'<joint name="leader" type="revolute"><parent link="palm"/><child link="one"/>{LIMIT}</joint>'
    + f'<joint name="follower" type="revolute"><parent link="palm"/><child link="two"/>{LIMIT}'
    + '<mimic joint="leader" multiplier="2" offset="0.1"/></joint></robot>'
)
ANGLE = 0.5
file = Path(sys.argv[1])
file.write_text(URDF)


def about_z(rotation):
    return round(float(np.arctan2(rotation[1, 0], rotation[0, 0])), 6)


robot = skrobot.models.urdf.RobotModelFromURDF(urdf_file=str(file))
robot.leader.joint_angle(ANGLE)
loaded = urchin.URDF.load(str(file))
poses = {link.name: pose for link, pose in loaded.link_fk(cfg={"leader": ANGLE}).items()}
model = pin.buildModelFromXML(URDF, True)
data = model.createData()
pin.framesForwardKinematics(model, data, np.array([ANGLE]))
seen = {
    "scikit-robot": about_z(robot.two.worldrot()),
    "urchin": about_z(poses["two"]),
    "pin": about_z(data.oMf[model.getFrameId("two")].rotation),
}
print(f"guess: the follower is at 2 * {ANGLE} + 0.1 = 1.1 rad in all three")
for name, angle in seen.items():
    print(f"seen in {name} {version(name)}: {angle:g} rad")
sys.exit(seen != {"scikit-robot": 1.0, "urchin": 1.1, "pin": 1.1})
PYTHON
