#!/usr/bin/env bash
# A URDF with moments of inertia of 1, 0.1 and 0.1, which no body has: MuJoCo refuses it, Pinocchio takes it, PyBullet makes all three 0, and Drake makes them those of a ball of water.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet drake==1.51.1 mujoco==4.0.0 numpy==2.4.6 pin==4.1.0 pybullet==3.2.7
cat > "$folder/robot.urdf" <<'URDF'
<robot name="r"><link name="base"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<link name="arm"><inertial><mass value="2"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="10" velocity="5"/></joint></robot>
URDF
cat > "$folder/run.py" <<'PYTHON'
import sys

import mujoco
import pinocchio
import pybullet as p
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

PATH = "robot.urdf"


def in_drake():
    """Return the three moments of inertia of the arm [kg m2]."""
    plant = MultibodyPlant(1e-3)
    Parser(plant).AddModels(PATH)
    plant.Finalize()
    inertia = plant.GetBodyByName("arm").CalcSpatialInertiaInBodyFrame(plant.CreateDefaultContext())
    return inertia.CalcRotationalInertia().get_moments()


def in_mujoco():
    """Return the same."""
    return mujoco.MjModel.from_xml_path(PATH).body_inertia[-1]


def in_pinocchio():
    """Return the same."""
    return pinocchio.buildModelFromUrdf(PATH).inertias[-1].inertia.diagonal()


def in_pybullet():
    """Return the same."""
    p.connect(p.DIRECT)
    body = p.loadURDF(PATH, useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE)
    return p.getDynamicsInfo(body, 0)[2]


with open(sys.argv[1], "w") as seen:
    for ask in (in_drake, in_mujoco, in_pinocchio, in_pybullet):
        try:
            print(ask.__name__, *(round(float(moment), 4) for moment in ask()), file=seen)
        except ValueError:
            print(ask.__name__, "ValueError", file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "drake 1.51.1, mujoco 4.0.0, pin 4.1.0, pybullet 3.2.7: moments of inertia of a link whose file says 1 0.1 0.1"
echo "guess: an error in all four"
echo "seen (Drake and PyBullet warn):"
cat seen
cmp - seen <<'SEEN'
in_drake 0.0049 0.0049 0.0049
in_mujoco ValueError
in_pinocchio 1.0 0.1 0.1
in_pybullet 0.0 0.0 0.0
SEEN
