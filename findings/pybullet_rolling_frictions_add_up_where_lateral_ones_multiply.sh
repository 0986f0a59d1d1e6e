#!/usr/bin/env bash
# PyBullet: the lateral frictions of two bodies are multiplied, their rolling frictions are added, each
# times the lateral friction of the other body: 0.01 on the ball and 0.01 on the floor brake like 0.02.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pybullet==3.2.7 numpy==2.2.6
"$folder/venv/bin/python" - 2>&1 <<'PYTHON' | grep -v "^pybullet build time"
import sys
from importlib.metadata import version

import pybullet as p

GRAVITY, RADIUS, ROLLING, SECONDS, STEP = 9.81, 0.1, 0.01, 0.5, 1e-3
ONE = 5 / 7 * ROLLING * GRAVITY / RADIUS
"""Deceleration of a ball for a rolling friction of 0.01, an arm in metres [m/s2]."""


def deceleration(of_ball, of_floor, lateral=1.0):
    """Return the deceleration of a ball that rolls at 1 m/s [m/s2]."""
    p.resetSimulation()
    p.setGravity(0, 0, -GRAVITY)
    p.setTimeStep(STEP)
    floor = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
    p.changeDynamics(floor, -1, lateralFriction=lateral, rollingFriction=of_floor)
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=RADIUS)
    ball = p.createMultiBody(1, shape, -1, [0, 0, RADIUS])
    p.changeDynamics(
        ball, -1, lateralFriction=1, rollingFriction=of_ball, linearDamping=0, angularDamping=0
    )
    p.resetBaseVelocity(ball, [1, 0, 0], [0, 1 / RADIUS, 0])
    for _ in range(round(SECONDS / STEP)):
        p.stepSimulation()
    return (1 - p.getBaseVelocity(ball)[0][0]) / SECONDS


p.connect(p.DIRECT)
seen = {
    "on the ball": deceleration(ROLLING, 0),
    "on both": deceleration(ROLLING, ROLLING),
    "on the ball, lateral friction 0.5 of the floor": deceleration(ROLLING, 0, lateral=0.5),
}
print(f"pybullet {version('pybullet')}; 0.01 on one body should brake with {ONE:.3f} m/s2")
print("guess: they multiply as lateral ones do: on the ball alone there is none")
for name, value in seen.items():
    print(f"seen {name}: {value:.3f} m/s2, {value / ONE:.2f} times that")
sys.exit([round(value / ONE, 2) for value in seen.values()] != [1.0, 2.0, 0.5])
PYTHON
