"""Perception as a participant: what it wants of a scenario, and what it publishes."""

import math
from contextlib import closing

import msgspec
import numpy as np
import pytest
from support.services.control import Stand, make_config
from support.services.perception import (
    JOINTS,
    TOPS,
    Item,
    empty_world,
    load_fixed,
    open_store,
    write_robot,
)

from stepbus_kinematics import RobotModel
from stepbus_schemas import Description, Image, JointState, Poses, RunError, WiringError
from stepbus_store.perception.item_catalog import read_catalog
from stepbus_store.perception.perception import Perception
from stepbus_store.perception.segments import Palette
from stepbus_store.solids import rotation

MS = 1_000_000
TYPES = {"rgb": "Image/1", "depth": "Image/1", "joint_state": "JointState/1", "poses": "Poses/1"}
ANGLES = [0.3, 0.2, 0.3, -0.2, 0.4, 0.1]
CHASSIS = (1.5, -0.7, 0.0)
YAW = 0.6


def config(folder, inputs=tuple(TYPES), **params):
    write_robot(folder)
    params = {"model": "robot.urdf", "joints": JOINTS, **params}
    ports = {name: TYPES[name] for name in inputs}
    outputs = {"detections": "Detections/1"}
    return make_config("perception", ports, outputs, folder, params=params, step_ns=8 * MS)


def camera_pose(folder):
    """Return where the engine has the camera of the robot at ANGLES on a chassis that moved."""
    with closing(empty_world()) as engine:
        robot = load_fixed(engine, write_robot(folder), CHASSIS, (0.0, 0.0, YAW))
        for index, name in enumerate(engine.joints(robot)):
            if name in JOINTS:
                engine.put_joint(robot, index, ANGLES[JOINTS.index(name)], 0.0)
        return engine.frame(engine.links(robot)["camera"])


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """Return images, joint state, poses and their description with the robot over some items."""
    folder = tmp_path_factory.mktemp("store")
    eye, orientation = camera_pose(folder)
    with open_store(folder) as store:
        axes = rotation(orientation)
        floor = eye + axes[:, 2] * 0.35
        for n, kind in enumerate(("cola", "juice", "water")):
            x, y, _ = (floor + axes[:, 0] * 0.09 * (n - 1)).tolist()
            store.add(Item(f"{kind}_{n}", kind, (x, y, float(floor[2]) - TOPS[kind]), YAW + 0.2))
        images = store.see(eye, orientation)
        state = JointState(position=[9.0, *ANGLES[::-1]])
        yield (
            {**images, "joint_state": state, "poses": store.poses(CHASSIS, YAW)},
            store.description,
        )


def start(given, described, **details):
    participant = Perception(given)
    names = Description(names=["wheel", *JOINTS[::-1]])
    image = Description(names=["camera"], details=details)
    ports = {**dict.fromkeys(TYPES, image), "joint_state": names, "poses": described}
    participant.start(ports)
    return Stand(participant)


def test_detections_are_in_the_frame_of_the_chassis(tmp_path, seen):
    messages, described = seen
    found = start(config(tmp_path), described).update(0, **messages)["detections"]
    true = start(config(tmp_path, source="truth"), described).update(0, **messages)["detections"]
    assert found.frame == true.frame == "chassis"
    assert found.types == true.types == ["cola", "juice", "water"]
    assert np.abs(np.subtract(found.position, true.position)).max() < 2e-3
    assert found.orientation[1] == pytest.approx(true.orientation[1], abs=0.01)
    assert found.orientation[0] == (0.0, 0.0, 0.0, 1.0)
    assert min(found.confidence) > 0.8


def test_late_images_belong_to_the_joints_of_when_they_were_taken(tmp_path, seen):
    messages, described = seen
    at_once = start(config(tmp_path), described).update(0, **messages)
    late = start(config(tmp_path), described, latency=["16ms"])
    state, elsewhere = messages["joint_state"], JointState(position=[9.0, *[0.0] * 6])
    assert late.update(0, joint_state=state) == {}
    assert late.update(1, joint_state=elsewhere) == {}
    assert late.update(2, **{**messages, "joint_state": elsewhere}) == at_once


def test_truth_is_what_the_plant_says_seen_from_the_chassis(tmp_path, seen):
    messages, described = seen
    true = start(config(tmp_path, ["poses"], source="truth"), described).update(
        0, poses=messages["poses"]
    )
    relative = np.subtract(messages["poses"].position[1], CHASSIS)
    c, s = math.cos(YAW), math.sin(YAW)
    expected = (c * relative[0] + s * relative[1], c * relative[1] - s * relative[0], relative[2])
    assert true["detections"].position[0] == pytest.approx(expected)
    assert true["detections"].orientation[0] == pytest.approx((0, 0, math.sin(0.1), math.cos(0.1)))
    assert true["detections"].confidence == [1.0] * 3


def test_truth_is_told_once_a_period(tmp_path, seen):
    messages, described = seen
    stand = start(config(tmp_path, ["poses"], source="truth", period=0.04), described)
    told = [k for k in range(12) if stand.update(k, poses=messages["poses"])]
    assert told == [0, 5, 10]


def test_nothing_is_published_without_a_new_pair_of_images(tmp_path, seen):
    messages, described = seen
    stand = start(config(tmp_path), described)
    assert stand.update(0, **messages)
    assert stand.update(1, joint_state=messages["joint_state"]) == {}
    assert stand.update(2, rgb=messages["rgb"]) == {}


def test_images_that_cannot_be_read_are_refused_in_one_sentence(tmp_path, seen):
    messages, described = seen
    stand = start(config(tmp_path), described)
    rgb, depth = messages["rgb"], messages["depth"]
    cut = {**messages, "rgb": msgspec.structs.replace(rgb, data=rgb.data[:-3])}
    with pytest.raises(
        RunError,
        match="input 'rgb': 320 x 240 pixels",
    ):
        stand.update(3, **cut)
    twice = {**messages, "depth": rgb}
    with pytest.raises(RunError, match=r"'rgb' is rgb8, 'depth' is rgb8$"):
        stand.update(4, **twice)
    small = Image(
        width=2, height=1, encoding="32FC1", data=bytes(8), focal=depth.focal, centre=(0, 0)
    )
    with pytest.raises(RunError, match="come from different cameras"):
        stand.update(5, **{**messages, "depth": small})


@pytest.mark.parametrize(
    ("position", "sentence"),
    [([0.0], "carries 1 position"), ([math.nan] * 7, r"the angles .*nan.* rad")],
)
def test_joint_states_that_are_none_are_refused(tmp_path, seen, position, sentence):
    messages, described = seen
    state = JointState(position=position)
    with pytest.raises(RunError, match=f"'joint_state':? ?{sentence}"):
        start(config(tmp_path), described).update(0, **{**messages, "joint_state": state})


def test_poses_that_are_none_are_refused(tmp_path, seen):
    truth = start(config(tmp_path, ["poses"], source="truth"), seen[1])
    with pytest.raises(RunError, match="'poses': expected 4 poses, received 0"):
        truth.update(0, poses=Poses(position=[], orientation=[]))


def test_a_joint_may_be_called_like_the_cameras_link(tmp_path):
    path = write_robot(tmp_path)
    path.write_text(path.read_text().replace('<joint name="mount"', '<joint name="camera"'))
    links, q = ("chassis", "camera"), np.array(ANGLES)
    placed = RobotModel(path, JOINTS, links=links).frame_pose(q, "camera").copy()
    usual = RobotModel(write_robot(tmp_path), JOINTS, links=links).frame_pose(q, "camera")
    assert placed == usual


def test_a_black_thing_that_is_no_item_hides_no_item_and_is_none():
    details = {
        "type": ["", "can"],
        "color": ["0 0 0", "1 0 0"],
        "shape": ["", "cylinder 0.03 0.1;"],
    }
    catalog = read_catalog("poses", Description(names=["tyre", "can_1"], details=details))
    palette = Palette([item_type.color for item_type in catalog.types], catalog.others)
    pixels = np.array([[[0, 0, 0], [200, 0, 0]]], dtype=np.uint8)
    assert palette.classify(pixels).tolist() == [[-1, 0]]


def test_a_world_without_items_and_colours_shows_nothing(tmp_path, seen):
    details = {"type": [""], "color": [""], "shape": [""]}
    stand = start(config(tmp_path), Description(names=["chassis"], details=details))
    assert stand.update(0, **seen[0])["detections"].types == []


def problems(given, described=None):
    with pytest.raises(WiringError) as refused:
        start(given, described)
    return str(refused.value).splitlines()


def test_all_that_is_wrong_with_the_scenario_is_told_at_once(tmp_path):
    params = {"joints": [*JOINTS, "joint_7"], "camera": "camra", "min_confidence": 2}
    rows = problems(config(tmp_path, ["rgb", "joint_state", "poses"], **params, sorce="camera"))
    keys = [row.removeprefix("participants.perception.").split(": ")[0] for row in rows]
    assert keys == ["inputs", "params.min_confidence", "params.sorce"]


def test_all_that_the_model_lacks_is_told_at_once(tmp_path):
    rows = problems(config(tmp_path, joints=[*JOINTS, "joint_7"], camera="camra"))
    assert [row.split(": ")[1].split(" is ")[0] for row in rows] == [
        "joint 'joint_7'",
        "link 'camra'",
    ]


@pytest.mark.parametrize(
    ("details", "sentence"),
    [
        ({}, "describes no items: its details type, color, shape are missing or empty"),
        ({"type": ["cola"]}, "describes no items: its details color, shape are missing or empty"),
        ({"type": ["cola"], "color": [""], "shape": ["box 1 1 1"]}, "item type 'cola' has no colour"),
        ({"type": ["cola"], "color": ["1 0"], "shape": ["box 1 1 1"]}, "color '1 0' of 'cola' must be three"),
        ({"type": ["cola"], "color": ["1 0 0"], "shape": ["cone 1 1"]}, "item type 'cola': shape 'cone' is not supported"),
        ({"type": ["cola"], "color": ["1 0 nan"], "shape": ["box 1 1 1"]}, "color '1 0 nan' of 'cola' must be three numbers, `red green blue`"),
        ({"type": ["cola"], "color": ["0 0 0"], "shape": ["box 1 1 1"]}, "item type 'cola' has no colour"),
        ({"type": ["cola"], "color": ["1 0 0"], "shape": ["cylinder 0 1"]}, "item type 'cola': cannot parse shape 'cylinder 0 1'"),
        ({"type": ["cola", ""], "color": ["1 0 0", ""], "shape": ["box 1 1 1", ""]}, "details type, color, shape are missing"),
    ],
)  # fmt: skip
def test_a_description_that_cannot_be_used_is_refused(tmp_path, details, sentence):
    (row,) = problems(config(tmp_path), Description(names=["item"], details=details))
    assert row.startswith("input 'poses'")
    assert sentence in row


def test_a_kind_without_a_flat_top_is_left_to_the_truth(tmp_path):
    details = {
        "type": ["", "ball"],
        "color": ["", "1 0 0"],
        "shape": ["", "sphere 1 @ 0 0 1 0 0 0 1"],
    }
    described = Description(names=["chassis", "ball_1"], details=details)
    (row,) = problems(config(tmp_path), described)
    assert "cannot detect item types ball" in row
    poses = Poses(position=[(0, 0, 0), (2, 0, 0)], orientation=[(0, 0, 0, 1)] * 2)
    told = start(config(tmp_path, ["poses"], source="truth"), described).update(0, poses=poses)
    assert told["detections"].position == [(2, 0, 1)]


def test_a_joint_that_is_not_sensed_is_named(tmp_path, seen):
    participant = Perception(config(tmp_path))
    inputs = {
        **dict.fromkeys(TYPES, Description()),
        "joint_state": Description(names=JOINTS[1:]),
        "poses": seen[1],
    }
    with pytest.raises(WiringError, match="'joint_state' has no joint 'joint_0'"):
        participant.start(inputs)


def test_a_frame_that_the_plant_lacks_is_named(tmp_path, seen):
    (row,) = problems(config(tmp_path, ["poses"], source="truth", frame="chasis"), seen[1])
    assert row.endswith("'chasis'; did you mean 'chassis'?")
