#!/usr/bin/env bash
# Drake: of an MJCF motor with gear="50", 1 at its input is 1 N m in the joint, and 50 N m in MuJoCo; armature of a joint without a motor is left out.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet drake==1.51.1 mujoco==4.0.0 numpy==2.4.6
cat > "$folder/run.py" <<'PYTHON'
import sys

import mujoco
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

MODEL = """<mujoco model="m"><option gravity="0 0 0"/><worldbody><body>
<joint name="j" axis="0 0 1" armature="1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
</body></worldbody>
<actuator>{}</actuator></mujoco>"""


def in_drake(text):
    """Return the acceleration by 1 at the motor, and by 1 N m on the joint without a motor [rad/s2]."""
    plant = MultibodyPlant(0)
    Parser(plant).AddModelsFromString(text, "xml")
    plant.Finalize()
    context = plant.CreateDefaultContext()
    ports = plant.get_applied_generalized_force_input_port(), plant.get_actuation_input_port()
    ports[plant.num_actuators()].FixValue(context, [1.0])
    instance = plant.GetModelInstanceByName("m")
    return plant.get_generalized_acceleration_output_port(instance).Eval(context)[0]


def in_mujoco(text):
    """Return the same."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    (data.ctrl if model.nu else data.qfrc_applied)[:] = 1.0
    mujoco.mj_forward(model, data)
    return data.qacc[0]


with open(sys.argv[1], "w") as seen:
    motors = {f"gear {gear}": f'<motor name="m" joint="j" gear="{gear}"/>' for gear in (1, 50)}
    for name, motor in {**motors, "no motor": ""}.items():
        text = MODEL.format(motor)
        print(f"{name}: drake {in_drake(text):.2f}, mujoco {in_mujoco(text):.2f}", file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "drake 1.51.1, mujoco 4.0.0: acceleration of a joint of 1 kg m2 and armature 1 kg m2 by an input of 1"
echo "guess: 0.50, 25.00 and 0.50 rad/s2 in both"
echo "seen:"
cat seen
cmp - seen <<'SEEN'
gear 1: drake 0.50, mujoco 0.50
gear 50: drake 0.50, mujoco 25.00
no motor: drake 1.00, mujoco 0.50
SEEN
