#!/usr/bin/env bash
# PyBullet: loadSDF does not read relative_to of a pose: a link placed in another frame stands elsewhere and turned otherwise, without a word; Drake has it in its place.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet drake==1.51.1 numpy==2.4.6 pybullet==3.2.7
cat > "$folder/robot.sdf" <<'SDF'
<sdf version="1.9"><model name="m">
<link name="base"><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial></link>
<frame name="shoulder"><pose>0 0 1 0 0 1.5707963267948966</pose></frame>
<link name="arm"><pose relative_to="shoulder">0.5 0 0 0 0 0</pose>
<inertial><mass>2</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial></link>
<joint name="j" type="revolute"><parent>base</parent><child>arm</child>
<axis><xyz>1 0 0</xyz><limit><lower>-1</lower><upper>1</upper></limit></axis></joint>
</model></sdf>
SDF
cat > "$folder/run.py" <<'PYTHON'
import sys

import pybullet as p
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

p.connect(p.DIRECT)
(body,) = p.loadSDF("robot.sdf")
state = p.getLinkState(body, 0, computeForwardKinematics=1)
ours = (*state[4], p.getEulerFromQuaternion(state[5])[2])
plant = MultibodyPlant(1e-3)
Parser(plant).AddModels("robot.sdf")
plant.Finalize()
pose = plant.GetBodyByName("arm").EvalPoseInWorld(plant.CreateDefaultContext())
theirs = (*pose.translation(), pose.rotation().ToRollPitchYaw().yaw_angle())
with open(sys.argv[1], "w") as seen:
    for name, values in {"pybullet": ours, "drake": theirs}.items():
        print(f"{name}:", *(round(float(value), 3) + 0.0 for value in values), file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "pybullet 3.2.7, drake 1.51.1: x, y, z and yaw of a link 0.5 m in front of a frame that is 1 m up and a quarter turn to the left"
echo "guess: 0.0 0.5 1.0 1.571 in both, or an error"
echo "seen:"
cat seen
printf 'pybullet: 0.5 0.0 0.0 0.0\ndrake: 0.0 0.5 1.0 1.571\n' | cmp - seen
