#!/usr/bin/env bash
# PlaCo: the solver keeps a joint within its stops, at any speed: the velocity limit of the URDF is off.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet placo==0.10.2
cat > "$folder/try.py" <<'PYTHON'
from pathlib import Path

import numpy as np
import placo

MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
file = Path("robot.urdf").absolute()
file.write_text(f'''<robot name="r"><link name="base">{MASS}</link><link name="arm">{MASS}</link>
<link name="tip">{MASS}</link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-0.5" upper="0.5" effort="5" velocity="1"/></joint>
<joint name="f" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="1 0 0"/></joint>
</robot>''')
for limits_speed in (None, True):
    robot = placo.RobotWrapper(str(file), placo.Flags.ignore_collisions)
    solver = placo.KinematicsSolver(robot)
    solver.mask_fbase(True)
    solver.dt = 0.01
    if limits_speed:
        solver.enable_velocity_limits(True)
    goal = np.array([np.cos(1.2), np.sin(1.2), 0.0])
    solver.add_position_task("tip", goal).configure("tip", "soft", 1.0)
    angles = [0.0]
    for _ in range(100):
        solver.solve(True)
        robot.update_kinematics()
        angles.append(robot.get_joint("j"))
    print(f"at the end {angles[-1]:.3f} rad, at most {max(np.diff(angles)) / 0.01:.2f} rad/s")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "placo 0.10.2"
echo "guess: within -0.5 to 0.5 rad, and at most 1 rad/s"
echo "seen:  0.5 rad, in one step of 0.01 s: 50 rad/s; enable_velocity_limits(True) holds 1 rad/s"
diff - "$folder/seen" <<'SEEN'
at the end 0.500 rad, at most 50.00 rad/s
at the end 0.500 rad, at most 1.00 rad/s
SEEN
