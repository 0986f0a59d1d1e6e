"""The robot and the world of the store."""

import math

import numpy as np
import pinocchio as pin
import pytest
from support.store_paths import SCENARIOS

from stepbus_kinematics import RobotModel
from stepbus_plant import Params, SimulatedPlant, load_world
from stepbus_plant.poses import PoseSensor
from stepbus_store.motion.branches import AnalyticChain

STORE = SCENARIOS / "store"
ROBOT = STORE / "robot.urdf.xacro"
ARM = (
    "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint",
    "wrist_1_joint", "wrist_2_joint", "wrist_3_joint",
)  # fmt: skip
DOWN = np.diag([1.0, -1.0, -1.0])
"""Of `grasp`: z down, and the fingers open along the shelf."""


@pytest.fixture(scope="module")
def kinematics() -> RobotModel:
    return RobotModel(ROBOT, ARM)


def make_plant(**stock) -> SimulatedPlant:
    world = load_world(STORE / "world.yaml", stock)
    return SimulatedPlant(world, Params(world="world.yaml", joints=list(ARM)), 8_000_000, 0)


def branch(kinematics: RobotModel, position: list[float]) -> np.ndarray:
    """Return the solution that shelves and outlet have in common, shape (6,) [rad]."""
    target = pin.SE3(DOWN, np.array(position))
    ways = AnalyticChain(kinematics, "grasp").branches(target, np.zeros(6))
    ahead = [q for q in ways if q[2] > 0.5 and abs(q[4] + math.pi / 2) < 1e-6 and -1.0 < q[0] < 2.0]
    return max(ahead, key=lambda q: smallest(kinematics, q))


def smallest(kinematics: RobotModel, q: np.ndarray) -> float:
    matrix = kinematics.jacobian(q, kinematics.frame_id("grasp"))[1]
    return float(np.linalg.svd(matrix, compute_uv=False).min())


def test_plant_and_controller_agree_on_where_the_robots_links_are(kinematics):
    plant = make_plant(fill=0)
    sensor = PoseSensor(plant.physics, ["grasp", "camera", "left_pad", "forearm_link"])
    joints = plant.physics.joints
    for q in np.random.default_rng(0).uniform(-3, 3, (20, 6)):
        for name, angle in zip(ARM, q, strict=True):
            plant.physics.teleport(joints[name], angle, 0.0)
        for side in ("left_finger", "right_finger"):
            plant.physics.teleport(joints[side], 0.0, 0.0)  # as in a model without them
        poses = sensor.sense()
        rows = zip(sensor.names, poses.position, poses.orientation, strict=True)
        for name, position, orientation in rows:
            place = kinematics.frame_pose(q, name)
            assert position == pytest.approx(place.translation, abs=2e-7)  # floats of 32 bit
            turn = pin.Quaternion(np.array(orientation)).angularDistance(
                pin.Quaternion(place.rotation)
            )
            assert turn < 1e-6


def test_items_stand_still_and_so_does_the_robot():
    plant = make_plant(seed=7)
    names = [*plant.world.items, "chassis", "grasp"]
    sensor = PoseSensor(plant.physics, names)
    before = np.array(sensor.sense().position)
    for _ in range(250):
        plant.advance()
    after = sensor.sense()
    assert len(names) == 44
    assert np.abs(np.array(after.position) - before).max() < 0.0005
    turns = [pin.Quaternion(np.array(q)).toRotationMatrix() for q in after.orientation[:-1]]
    tilt = [pin.rpy.matrixToRpy(turn)[:2] for turn in turns]
    assert np.abs(tilt).max() < 0.002


@pytest.mark.parametrize("seed", range(3))
def test_every_type_is_on_every_shelf(seed):
    world = load_world(STORE / "world.yaml", {"seed": seed})
    for shelf in ("a", "b"):
        on_it = {item.type for item in world.items.values() if f"_{shelf}" in item.name}
        assert on_it == {"cola", "juice", "water", "soup"}


@pytest.mark.parametrize("tier", [1, 2, 3])
@pytest.mark.parametrize("above", [0.0, 0.1, 0.22])
@pytest.mark.parametrize("height", [0.1, 0.15])
def test_the_arm_reaches_an_item_in_front_of_the_base(kinematics, tier, above, height):
    items = load_world(STORE / "world.yaml").items.values()
    x, _, z = next(item.slot for item in items if f"_a{tier}_" in item.name)
    q = branch(kinematics, [x - 1.5, 0.0, z + 0.6 * height + above])
    assert smallest(kinematics, q) > 0.08
    assert kinematics.overload(q) is None


@pytest.mark.parametrize("x", [-0.03, 0.09, 0.21, 0.33])
@pytest.mark.parametrize("above", [0.0, 0.15])
def test_the_arm_reaches_the_outlet_from_home(kinematics, x, above):
    q = branch(kinematics, [x, 0.65, 0.35 + 0.6 * 0.115 + above])
    assert smallest(kinematics, q) > 0.15
    assert kinematics.overload(q) is None


def test_the_robot_starts_with_its_hand_low_inside_of_its_outline():
    plant = make_plant(fill=0)
    sensor = PoseSensor(plant.physics, ["hand", "grasp", "left_pad", "right_pad"])
    x, y, z = np.array(sensor.sense().position).T
    assert np.abs(x).max() < 0.30
    assert np.abs(y).max() < 0.22
    assert z.max() < 0.75
    plant.advance()
    robot = list(plant.world.bodies).index("robot")
    engine = plant.physics.engine
    touching = {contact.one for contact in engine.contacts(robot)}
    assert {name for name, link in engine.links(robot).items() if link in touching} <= {
        "left_wheel_link", "right_wheel_link", "front_caster", "back_caster",
    }  # fmt: skip
