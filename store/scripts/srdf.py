"""Print an SRDF: `python store/scripts/srdf.py robot.urdf joint …`.

It names the pairs of links that never touch, or always do, wherever the named joints stand, and
those that no named joint moves against one another.
"""

import itertools
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from stepbus_kinematics import RobotModel, collision_geometry
from stepbus_kinematics.self_collisions import keep_moving_pairs
from stepbus_schemas import WiringError

_SAMPLES = 10_000
_ALWAYS = 0.95
"""Share of the positions; meshes of neighbours may part in a few odd ones."""


def srdf_text(path: Path, joints: Sequence[str], samples: int = _SAMPLES) -> str:
    """Return an SRDF of the pairs that never or always touch in random positions of the joints.

    Pairs that none of the joints moves against one another are among them.

    path: URDF or xacro. Neighbours are among the pairs. Raises WiringError for an
    invalid file or unknown joints.
    """
    robot = RobotModel(path, joints, bounded=True)
    model, geometry = robot.model, collision_geometry(robot)
    shapes = geometry.geometryObjects
    links = [model.frames[shape.parentFrame].name for shape in shapes]
    movers = [shape.parentJoint for shape in shapes]
    geometry.addAllCollisionPairs()
    keep_moving_pairs(geometry)
    data, results = model.createData(), geometry.createData()
    random = np.random.Generator(np.random.PCG64(0))
    hits = np.zeros(len(geometry.collisionPairs))
    for _ in range(samples):
        q = robot.in_model(random.uniform(robot.lower, robot.upper))
        pin.computeCollisions(model, data, geometry, results, q, False)
        hits += [result.isCollision() for result in results.collisionResults]
    rows = []
    for pair, share in zip(geometry.collisionPairs, hits / samples, strict=True):
        first, second = movers[pair.first], movers[pair.second]
        if first == model.parents[second] or second == model.parents[first]:
            rows.append((pair.first, pair.second, "Adjacent"))
        elif share == 0 or share > _ALWAYS:
            rows.append((pair.first, pair.second, "Always" if share else "Never"))
    rows += [
        (first, second, "Fixed")
        for first, second in itertools.combinations(range(len(links)), 2)
        if movers[first] == movers[second] and links[first] != links[second]
    ]
    lines = [
        f'  <disable_collisions link1="{links[first]}" link2="{links[second]}" reason="{reason}"/>'
        for first, second, reason in rows
    ]
    return "\n".join([f'<robot name="{model.name}">', *lines, "</robot>"]) + "\n"


def _main(arguments: Sequence[str]) -> int:
    if len(arguments) < 2:
        sys.stderr.write("usage: srdf ROBOT JOINT…, e.g. srdf robot.urdf elbow wrist\n")
        return 2
    try:
        sys.stdout.write(srdf_text(Path(arguments[0]), arguments[1:]))
    except WiringError as exc:
        sys.stderr.write(f"{exc}\n")
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(_main(sys.argv[1:]))
