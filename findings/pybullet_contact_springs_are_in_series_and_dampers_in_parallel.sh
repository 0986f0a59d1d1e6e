#!/usr/bin/env bash
# PyBullet: where both bodies have contactStiffness and contactDamping, the contact is half as stiff as one of them, and damped twice as much.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6 pybullet==3.2.7
cat > "$folder/run.py" <<'PYTHON'
import math
import sys

import pybullet as p

GRAVITY, STEP = 10.0, 1e-4
p.connect(p.DIRECT)


def measured(of_ball, of_floor):
    """Return stiffness [N/m] and damping [N s/m] by the rest and the overshoot of a ball of 1 kg."""
    p.resetSimulation()
    p.setTimeStep(STEP)
    p.setGravity(0, 0, -GRAVITY)
    floor = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
    ball = p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1), -1, [0, 0, 0.1])
    p.changeDynamics(ball, -1, linearDamping=0, angularDamping=0)
    for body, given in ((ball, of_ball), (floor, of_floor)):
        if given:
            p.changeDynamics(body, -1, contactStiffness=given[0], contactDamping=given[1])
    depths = []
    for _ in range(round(1 / STEP)):
        p.stepSimulation()
        depths.append(0.1 - p.getBasePositionAndOrientation(ball)[0][2])
    rest = depths[-1]
    decay = -math.log(max(depths) / rest - 1)
    stiffness = GRAVITY / rest
    return stiffness, 2 * decay / math.hypot(math.pi, decay) * math.sqrt(stiffness)


with open(sys.argv[1], "w") as seen:
    for name, pair in {"on the ball": ((2000, 20), None), "on both": ((2000, 20),) * 2}.items():
        stiffness, damping = measured(*pair)
        print(f"{name}: {stiffness / 100:.0f}00 N/m, {damping:.0f} N s/m", file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "pybullet 3.2.7: contactStiffness=2000, contactDamping=20, given to a ball or to ball and floor"
echo "guess: two springs in series are half as stiff, with their dampers half as damped: 1000 N/m, 10 N s/m"
echo "seen:"
cat seen
printf 'on the ball: 2000 N/m, 20 N s/m\non both: 1000 N/m, 40 N s/m\n' | cmp - seen
