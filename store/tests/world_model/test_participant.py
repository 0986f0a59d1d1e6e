"""The world model as a participant: what it makes of map, odometry, joints and detections."""

import math

import numpy as np
import pytest
from support.services.control import Stand, make_config
from support.store_paths import SCENARIOS

from stepbus_schemas import (
    BaseState,
    Description,
    Detections,
    GripperState,
    JointState,
    Poses,
    WiringError,
)
from stepbus_store.world_model.world_model import WorldModel

STORE = SCENARIOS / "store"
ARM = [
    "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint",
    "wrist_1_joint", "wrist_2_joint", "wrist_3_joint",
]  # fmt: skip
TUCK = [0.0, -2.9, 2.7, -1.6, -math.pi / 2, -math.pi / 2]
NAMES = ["chassis", "grasp", "left_pad", "cola_a1_1", "landmark_1", "landmark_2", "wall"]
IDENTITY = (0.0, 0.0, 0.0, 1.0)
AT = [(0, 0, 0), (0, 0, 0), (0, 0, 0), (2.0, 0.1, 0.2), (1.9, 0.0, 0.2), (1.9, 0.3, 0.2), (3, 0, 0)]
TYPES = {
    "planogram": "Poses/1", "odometry": "BaseState/1", "joint_state": "JointState/1",
    "gripper": "GripperState/1", "detections": "Detections/1",
}  # fmt: skip


def config(**params):
    outputs = {"pose": "BaseState/1", "poses": "Poses/1"}
    params = {"model": "robot.urdf.xacro", "joints": ARM, **params}
    return make_config("world", TYPES, outputs, STORE, params=params, step_ns=16_000_000)


def described(names=NAMES):
    own = {"chassis", "grasp", "left_pad"}
    bodies = ["robot" if name in own else name for name in names]
    types = ["cola" if name.startswith("cola") else "" for name in names]
    return {
        "planogram": Description(names=list(names), details={"body": bodies, "type": types}),
        "joint_state": Description(names=ARM),
    }


def inputs(x=0.0, y=0.0, yaw=0.0, *, holding=False, width=0.09):
    return {
        "odometry": BaseState(x=x, y=y, yaw=yaw, vx=0.0, wz=0.0),
        "joint_state": JointState(position=TUCK),
        "gripper": GripperState(width=width, force=0.0, holding=holding),
    }


def started():
    participant = WorldModel(config())
    participant.start(described())
    return Stand(participant)


def first(stand, **rest):
    poses = Poses(position=AT, orientation=[IDENTITY] * len(NAMES))
    return stand.update(0, planogram=poses, **inputs(**rest))


def where(messages, name):
    return messages["poses"].position[NAMES.index(name)]


def test_it_starts_from_the_planogram():
    messages = first(started())
    assert where(messages, "cola_a1_1") == (2.0, 0.1, 0.2)
    assert where(messages, "wall") == (3, 0, 0)
    assert messages["pose"] == BaseState(x=0.0, y=0.0, yaw=0.0, vx=0.0, wz=0.0)


def test_the_base_starts_where_the_planogram_has_it():
    half = math.pi / 4
    position = [(1.0, 2.0, 0.1), *AT[1:]]
    orientation = [(0.0, 0.0, math.sin(half), math.cos(half)), *[IDENTITY] * (len(NAMES) - 1)]
    stand = started()
    messages = stand.update(
        0, planogram=Poses(position=position, orientation=orientation), **inputs()
    )
    assert where(messages, "chassis") == pytest.approx((1.0, 2.0, 0.1))
    messages = stand.update(3, **inputs(0.5, 0.0, 0.0))
    pose = messages["pose"]
    assert (pose.x, pose.y, pose.yaw) == pytest.approx((1.0, 2.5, math.pi / 2))
    assert where(messages, "chassis") == pytest.approx((1.0, 2.5, 0.1))


def test_the_links_of_the_robot_follow_from_its_joints_and_its_pose():
    stand = started()
    # As the comment in robot.urdf.xacro has it.
    assert where(first(stand), "grasp") == pytest.approx((0.263, 0.109, 0.579), abs=2e-3)
    messages = stand.update(3, **inputs(1.0, 0.0, math.pi / 2))
    assert where(messages, "grasp") == pytest.approx((1.0 - 0.109, 0.263, 0.579), abs=2e-3)


def test_the_pads_are_where_the_width_of_the_gripper_has_them():
    # They open along the base's x axis with the wrist tucked in.
    wide, narrow = (
        np.array(where(first(started(), width=width), "left_pad")) for width in (0.09, 0.05)
    )
    assert np.linalg.norm(wide - narrow) == pytest.approx(0.02)


def test_poses_come_once_per_period_and_the_pose_at_every_step():
    stand = started()
    first(stand)
    published = [stand.update(k, **inputs()) for k in range(1, 7)]
    assert [k for k, messages in enumerate(published, 1) if "poses" in messages] == [3, 6]
    assert all("pose" in messages for messages in published)


def detections(*rows):
    return Detections(
        frame="chassis",
        types=[kind for kind, _ in rows],
        position=[at for _, at in rows],
        orientation=[IDENTITY] * len(rows),
        confidence=[1.0] * len(rows),
    )


def test_landmarks_correct_the_pose_and_items_are_taken_from_where_they_are_seen():
    stand = started()
    first(stand)
    stand.update(1, **inputs(1.5, 0.0, 0.0))
    # The base is really 20 mm farther ahead.
    found = detections(
        ("landmark", (0.38, 0.0, 0.2)), ("landmark", (0.38, 0.3, 0.2)), ("cola", (0.485, 0.1, 0.25))
    )
    for k in range(2, 7):
        messages = stand.update(k, detections=found, **inputs(1.5, 0.0, 0.0))
    assert messages["pose"].x == pytest.approx(1.52, abs=1e-3)
    assert where(messages, "cola_a1_1") == pytest.approx((2.005, 0.1, 0.2), abs=1e-3)


def test_a_planogram_without_the_robot_is_refused():
    participant = WorldModel(config())
    with pytest.raises(WiringError, match="has no link 'chassis' with a body"):
        participant.start(described(NAMES[1:]))


def test_links_that_the_model_lacks_are_refused():
    participant = WorldModel(config())
    inputs = described([*NAMES, "tail"])
    inputs["planogram"].details["body"][-1] = "robot"
    with pytest.raises(WiringError, match="links tail are not in"):
        participant.start(inputs)
