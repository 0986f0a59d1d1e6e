#!/usr/bin/env bash
# A URDF with effort="0", as exporters write: MuJoCo does not limit the torque of the joint, Pinocchio says that its limit is 0, and Drake leaves its motor out.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet drake==1.51.1 mujoco==4.0.0 numpy==2.4.6 pin==4.1.0
cat > "$folder/run.py" <<'PYTHON'
import sys
from pathlib import Path

import mujoco
import pinocchio
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

ROBOT = """<robot name="r"><link name="base"/>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="{}" velocity="5"/></joint><transmission name="t">
<type>transmission_interface/SimpleTransmission</type><joint name="j"/><actuator name="m"/>
</transmission></robot>"""


def in_drake(path):
    """Return the limit of the joint's motor [N m]."""
    plant = MultibodyPlant(1e-3)
    Parser(plant).AddModels(path)
    plant.Finalize()
    motors = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    return [motor.effort_limit() for motor in motors] or ["no motor"]


def in_mujoco(path):
    """Return the acceleration by a torque of 100 N m, of 1 kg m2 [rad/s2]."""
    spec = mujoco.MjSpec.from_file(path)
    spec.add_actuator(name="m", target="j", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.ctrl[0] = 100
    mujoco.mj_forward(model, data)
    return data.qacc


def in_pinocchio(path):
    """Return the limit of the joint [N m]."""
    return pinocchio.buildModelFromUrdf(path).upperEffortLimit


with open(sys.argv[1], "w") as seen:
    for effort in (10, 0):
        path = f"{effort}.urdf"
        Path(path).write_text(ROBOT.format(effort))
        drake, ours, pin = (ask(path)[0] for ask in (in_drake, in_mujoco, in_pinocchio))
        print(f"effort={effort}: drake {drake}, mujoco {ours:.0f}, pinocchio {pin:.0f}", file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "drake 1.51.1, mujoco 4.0.0, pin 4.1.0: the torque that a joint lets through, of 100 N m in MuJoCo"
echo "guess: 10 in each, then 0 in each"
echo "seen:"
cat seen
cmp - seen <<'SEEN'
effort=10: drake 10.0, mujoco 10, pinocchio 10
effort=0: drake no motor, mujoco 100, pinocchio 0
SEEN
