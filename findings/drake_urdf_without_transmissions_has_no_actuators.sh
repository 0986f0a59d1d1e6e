#!/usr/bin/env bash
# Drake: a joint of a URDF with an effort limit has an actuator only if the file has a <transmission> for it.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet drake==1.51.1
cat > "$folder/try.py" <<'PYTHON'
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

LINK = (
    '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
)
ROBOT = (
    '<robot name="robot"><link name="base"/>' + LINK.format("arm")
    + '<joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>'
    + '<limit lower="-1" upper="1" effort="10" velocity="10"/></joint></robot>'
)
TRANSMISSION = (
    '<transmission name="drive"><type>SimpleTransmission</type><joint name="shoulder"/>'
    '<actuator name="motor"/></transmission></robot>'
)
for name, text in (("without", ROBOT), ("with", ROBOT.replace("</robot>", TRANSMISSION))):
    plant = MultibodyPlant(0.001)
    Parser(plant).AddModelsFromString(text, "urdf")
    plant.Finalize()
    print(f"{name} transmission: {plant.num_actuators()}")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "Drake 1.51.1: the same revolute joint without and with a <transmission>; the actuators of the plant"
echo "guess: 1 and 1"
echo "seen:  0 and 1"
printf 'without transmission: 0\nwith transmission: 1\n' | cmp - "$folder/seen"
