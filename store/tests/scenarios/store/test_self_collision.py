"""The store's robot collides with itself in the physics, and is free where it should be."""

import numpy as np
import pytest
from support.store_paths import SCENARIOS

from stepbus_plant import Params, SimulatedPlant, load_world
from stepbus_schemas import JointCommand

WORLD = SCENARIOS / "store/world.yaml"
ARM = (
    "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint",
    "wrist_1_joint", "wrist_2_joint", "wrist_3_joint",
)  # fmt: skip
TUCK = np.array([0.0, -2.9, 2.7, -1.6, -np.pi / 2, -np.pi / 2])
INTO_CHASSIS = np.array([0.0, -2.9, 2.7, -0.9, -np.pi / 2, -np.pi / 2])


@pytest.fixture(scope="module")
def plant():
    plant = SimulatedPlant(
        load_world(WORLD), Params(world=str(WORLD), joints=ARM, cameras=False), 16_000_000, 0
    )
    yield plant
    plant.close()


def own_contacts(plant):
    """Return the deepest penetration between links of the robot [m], and the largest force [N]."""
    robot = next(iter(plant.physics.joints.values())).body
    points = [p for p in plant.physics.engine.contacts(robot) if p.other[0] == robot]
    return min((p.distance for p in points), default=0.0), max(
        (p.force for p in points), default=0.0
    )


def move(plant, target, seconds):
    start, steps = np.array(plant.sense().position), round(seconds / 0.016)
    commander = plant.commander("arm", ARM)
    for k in range(1, steps + 1):
        q = start + (target - start) * k / steps
        commander.apply(JointCommand(mode="position", values=q.tolist()))
        plant.advance()


def test_in_its_tuck_pose_it_touches_itself_nowhere(plant):
    move(plant, TUCK, 0.2)
    assert own_contacts(plant) == (0.0, 0.0)


def test_the_arm_does_not_pass_into_the_chassis(plant):
    move(plant, INTO_CHASSIS, 2.0)
    depth, force = own_contacts(plant)
    assert force > 20.0
    assert depth > -3e-3
