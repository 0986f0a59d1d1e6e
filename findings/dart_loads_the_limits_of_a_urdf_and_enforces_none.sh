#!/usr/bin/env bash
# DART: a joint of a URDF has its limits of position, speed and effort, and passes them all.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet dartpy==6.20.0 numpy==2.4.6
cat > "$folder/try.py" <<'PYTHON'
from pathlib import Path

import dartpy

URDF = '''<robot name="r"><link name="world"/><link name="arm"><inertial><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="world"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-0.5" upper="0.5" effort="5" velocity="1"/></joint></robot>'''
file = Path("robot.urdf").absolute()
file.write_text(URDF)
for is_enforced in (None, True):
    world = dartpy.simulation.World()
    robot = dartpy.utils.DartLoader().parseSkeleton(str(file))
    world.addSkeleton(robot)
    joint = robot.getJoint("j")
    limits = joint.getPositionUpperLimit(0), joint.getVelocityUpperLimit(0)
    print("limits", *limits, joint.getForceUpperLimit(0), joint.areLimitsEnforced())
    if is_enforced:
        joint.setLimitEnforcement(True)
    fastest = 0.0
    for _ in range(1000):
        joint.setForce(0, 20.0)
        world.step()
        fastest = max(fastest, joint.getVelocity(0))
    print(f"after 1 s of 20 N·m: {joint.getPosition(0):.1f} rad, at most {fastest:.1f} rad/s")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "dartpy 6.20.0"
echo "guess: 20 N·m are cut to 5 N·m, the joint turns at 1 rad/s and stops at 0.5 rad"
echo "seen:  100 rad and 200 rad/s, by 20 N·m; with setLimitEnforcement(True) as guessed"
diff - "$folder/seen" <<'SEEN'
limits 0.5 1.0 5.0 False
after 1 s of 20 N·m: 100.1 rad, at most 200.0 rad/s
limits 0.5 1.0 5.0 False
after 1 s of 20 N·m: 0.5 rad, at most 1.0 rad/s
SEEN
