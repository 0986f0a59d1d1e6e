#!/usr/bin/env bash
# PyBullet: after restoreState in another client, getContactPoints returns the same points with the same
# forces, in another order: sums over them are rounded otherwise.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pybullet==3.2.7 numpy==2.4.6
cat > "$folder/try.py" <<'PYTHON'
import pybullet


def world():
    """Return a floor, and four boxes on it."""
    client = pybullet.connect(pybullet.DIRECT)
    pybullet.setPhysicsEngineParameter(deterministicOverlappingPairs=1, physicsClientId=client)
    pybullet.setGravity(0, 0, -9.81, physicsClientId=client)
    floor = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[5, 5, 0.1], physicsClientId=client)
    pybullet.createMultiBody(0, floor, basePosition=[0, 0, -0.1], physicsClientId=client)
    box = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1], physicsClientId=client)
    for number in range(4):
        pybullet.createMultiBody(1, box, basePosition=[number, 0, 0.1], physicsClientId=client)
    return client


def points(client):
    return pybullet.getContactPoints(physicsClientId=client)


def run(client, steps):
    for _ in range(steps):
        pybullet.stepSimulation(client)


one, other = world(), world()
run(one, 100)
for place in ([1, 0, 2], [1, 0, 0.1]):
    # The second box is lifted and put back.
    pybullet.resetBasePositionAndOrientation(2, place, [0, 0, 0, 1], one)
    run(one, 100)
pybullet.saveBullet("state.bullet", physicsClientId=one)
pybullet.restoreState(fileName="state.bullet", physicsClientId=other)
for steps in (0, 100):
    run(one, steps)
    run(other, steps)
    before, after = points(one), points(other)
    print(steps, "steps on: the same points", sorted(before) == sorted(after), "in the same order", before == after)
    print("  pairs:", [r[1:3] for r in before[::4]], "restored:", [r[1:3] for r in after[::4]])
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "pybullet 3.2.7: four boxes on a floor, the second is lifted and put back; saveBullet, restoreState in another client"
echo "guess: the lists of contact points are equal"
echo "seen:  they have the same points in another order, and keep it"
cat > "$folder/expected" <<'END'
0 steps on: the same points True in the same order False
  pairs: [(0, 4), (0, 3), (0, 1), (0, 2)] restored: [(0, 4), (0, 3), (0, 2), (0, 1)]
100 steps on: the same points True in the same order False
  pairs: [(0, 4), (0, 3), (0, 1), (0, 2)] restored: [(0, 4), (0, 3), (0, 2), (0, 1)]
END
cmp "$folder/expected" "$folder/seen"
