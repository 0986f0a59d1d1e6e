#!/usr/bin/env bash
# Drake: a plant with time_step=0 goes through the joint limits of its URDF; one with a time step stops there.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet drake==1.51.1
cat > "$folder/try.py" <<'PYTHON'
import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator

LINK = (
    '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
)
ROBOT = (
    '<robot name="robot"><link name="base"/>' + LINK.format("arm")
    + '<joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>'
    + '<limit lower="-1" upper="1" effort="10" velocity="10"/></joint></robot>'
)
for step in (0.0, 0.001):
    plant = MultibodyPlant(step)
    Parser(plant).AddModelsFromString(ROBOT, "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    simulator = Simulator(plant)
    plant.SetVelocities(simulator.get_mutable_context(), np.array([1.0]))
    simulator.Initialize()
    simulator.AdvanceTo(2.0)
    print(f"time_step {step}: {plant.GetPositions(simulator.get_context())[0]:.1f} rad")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "Drake 1.51.1: a joint with the limits -1 and 1 at 1 rad/s, no forces; where it is after 2 s"
echo "guess: 1.0 both times"
echo "seen:  2.0 in the continuous plant"
printf 'time_step 0.0: 2.0 rad\ntime_step 0.001: 1.0 rad\n' | cmp - "$folder/seen"
