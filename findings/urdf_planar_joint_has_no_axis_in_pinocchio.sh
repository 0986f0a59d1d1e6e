#!/usr/bin/env bash
# Pinocchio: a planar joint of a URDF lies in the plane of x and y whatever its axis; Drake and MuJoCo turn about the axis of the file.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet drake==1.51.1 mujoco==4.0.0 numpy==2.4.6 pin==4.1.0
cat > "$folder/robot.urdf" <<'URDF'
<robot name="r"><link name="base"/><link name="cart"><inertial><mass value="1"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.25"/></inertial></link>
<joint name="j" type="planar"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/></joint></robot>
URDF
cat > "$folder/run.py" <<'PYTHON'
import sys

import mujoco
import numpy as np
import pinocchio
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

PATH = "robot.urdf"


def in_drake():
    """Return the diagonal of the mass matrix: two masses, and the inertia about the joint's normal."""
    plant = MultibodyPlant(1e-3)
    Parser(plant).AddModels(PATH)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return np.diag(plant.CalcMassMatrix(plant.CreateDefaultContext()))


def in_mujoco():
    """Return the same."""
    model = mujoco.MjModel.from_xml_path(PATH)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.zeros((3, 3))
    mujoco.mj_fullM(model, data, mass)
    return np.diag(mass)


def in_pinocchio():
    """Return the same."""
    model = pinocchio.buildModelFromUrdf(PATH)
    return np.diag(pinocchio.crba(model, model.createData(), pinocchio.neutral(model)))


with open(sys.argv[1], "w") as seen:
    for ask in (in_drake, in_mujoco, in_pinocchio):
        print(ask.__name__, *(round(float(value), 3) for value in ask()), file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "drake 1.51.1, mujoco 4.0.0, pin 4.1.0: mass matrix of a body with the inertias 0.1 0.2 0.25 on a planar joint with the axis x"
echo "guess: 1.0 1.0 0.1 in all, since it turns about x"
echo "seen:"
cat seen
cmp - seen <<'SEEN'
in_drake 1.0 1.0 0.1
in_mujoco 1.0 1.0 0.1
in_pinocchio 1.0 1.0 0.25
SEEN
