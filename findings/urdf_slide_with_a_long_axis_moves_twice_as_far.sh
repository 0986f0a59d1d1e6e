#!/usr/bin/env bash
# URDF: an axis of `2 0 0` is a direction for Pinocchio and MuJoCo. PyBullet and yourdfpy multiply by
# it: a prismatic joint at 1 m stands at 2 m. Two of them in one loop disagree by a factor, silently.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet \
    numpy==2.4.6 pybullet==3.2.7 pin==4.1.0 mujoco==3.3.7 yourdfpy==0.0.60
"$folder/venv/bin/python" - "$folder/slide.urdf" 2>/dev/null <<'PYTHON' | grep -v "^pybullet build time"
import sys
from importlib.metadata import version
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pybullet
import yourdfpy

INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
URDF = (
    f'<robot name="slide"><link name="base">{INERTIAL}</link><link name="cart">{INERTIAL}</link>'
    '<joint name="rail" type="prismatic"><parent link="base"/><child link="cart"/>'
    '<axis xyz="2 0 0"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint></robot>'
)
file = Path(sys.argv[1])
file.write_text(URDF)

model = pin.buildModelFromXML(URDF)
data = model.createData()
pin.framesForwardKinematics(model, data, np.array([1.0]))
own = mujoco.MjModel.from_xml_string(URDF)
state = mujoco.MjData(own)
state.qpos[:] = 1
mujoco.mj_forward(own, state)
pybullet.connect(pybullet.DIRECT)
robot = pybullet.loadURDF(str(file), useFixedBase=True)
pybullet.resetJointState(robot, 0, 1.0)
loaded = yourdfpy.URDF.load(str(file))
loaded.update_cfg([1.0])
seen = {
    "pin": data.oMf[model.getFrameId("cart")].translation[0],
    "mujoco": state.body("cart").xpos[0],
    "pybullet": pybullet.getLinkState(robot, 0, computeForwardKinematics=True)[4][0],
    "yourdfpy": loaded.get_transform("cart", "base")[0, 3],
}
print("guess: an axis is a direction; the cart stands at 1 m in all four")
for name, place in seen.items():
    print(f"seen in {name} {version(name)}: {float(place):g} m")
sys.exit(seen != {"pin": 1, "mujoco": 1, "pybullet": 2, "yourdfpy": 2})
PYTHON
