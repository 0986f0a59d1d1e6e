#!/usr/bin/env bash
# PyBullet: with deterministicOverlappingPairs=1, what saveState has kept goes on to the same bits for
# boxes and convex meshes in contact. A body of two boxes goes another way after restoreState, in the
# first step, also alone on a plane.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pybullet==3.2.7 numpy==2.2.6
"$folder/venv/bin/python" - 2>&1 <<'PYTHON' | grep -v "^pybullet build time"
import sys
from importlib.metadata import version

import pybullet as p

TILTED = p.getQuaternionFromEuler([0.3, 0.2, 0.1])


def box():
    return p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.05, 0.03])


def hull():
    corners = [[x, y, z] for x in (-0.1, 0.1) for y in (-0.05, 0.05) for z in (-0.03, 0.03)]
    return p.createCollisionShape(p.GEOM_MESH, vertices=[*corners, [0, 0, 0.06]])


def two_boxes():
    return p.createCollisionShapeArray(
        [p.GEOM_BOX, p.GEOM_BOX],
        halfExtents=[[0.1, 0.03, 0.03], [0.03, 0.1, 0.03]],
        collisionFramePositions=[[0, 0, 0], [0.1, 0, 0]],
    )


def step_of_difference(shape, bodies, before=60, after=100):
    """Return the first step in which the restored state goes another way; None: in none."""
    p.resetSimulation()
    p.setPhysicsEngineParameter(deterministicOverlappingPairs=1)
    p.setGravity(0, 0, -9.81)
    p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
    made = [
        p.createMultiBody(1, shape(), -1, [0.02 * i, 0.01 * i, 0.12 + 0.15 * i], TILTED)
        for i in range(bodies)
    ]

    def steps(count):
        rows = []
        for _ in range(count):
            p.stepSimulation()
            rows.append([(p.getBasePositionAndOrientation(b), p.getBaseVelocity(b)) for b in made])
        return rows

    steps(before)
    state = p.saveState()
    first = steps(after)
    p.restoreState(state)
    again = steps(after)
    return next((i for i in range(after) if first[i] != again[i]), None)


p.connect(p.DIRECT)
seen = {
    (shape.__name__, bodies): step_of_difference(shape, bodies)
    for shape in (box, hull, two_boxes)
    for bodies in (1, 4)
}
print(f"pybullet {version('pybullet')}")
print("guess: the restored state goes on to the same bits, whatever the shapes")
for (name, bodies), step in seen.items():
    print(f"seen with {bodies} of {name}: {'the same bits' if step is None else f'another way in step {step}'}")
as_seen = all((step is not None) == (name == "two_boxes") for (name, _), step in seen.items())
sys.exit(0 if as_seen else 1)
PYTHON
