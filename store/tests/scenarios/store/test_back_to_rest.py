"""An arm goes back to rest in the plant, from a dozen poses in which a run may have stopped."""

import math
import random

import pytest
from support.runs.store import last, store, texts

from stepbus_orchestrator.recording import Recording
from stepbus_participant import package_path
from stepbus_plant.world_file import load_world

pytestmark = pytest.mark.slow

TUCK = {
    "shoulder_pan_joint": 0.0, "shoulder_lift_joint": -2.9, "elbow_joint": 2.7,
    "wrist_1_joint": -1.6, "wrist_2_joint": -math.pi / 2, "wrist_3_joint": -math.pi / 2,
}  # fmt: skip
TIP = "tip: grasp, frame: odometry, rpy: [3.141592653589793, 0, 0]"
GROUND = {"floor"}
PADS = {"left_pad", "right_pad"}
MOST = 30.0
"""Of the robot on anything but the ground and between its pads [N]."""


def item_of(seed, chance):
    """Return an item in the lowest row of a shelf."""
    folder = package_path("package://stepbus_store/scenarios/store")
    items = load_world(folder / "world.yaml", {"seed": seed}).items.values()
    return chance.choice([row for row in items if "_a1_" in row.name])


def tip(goal_type, item, height, touches=""):
    x, y, z = item.position
    place = f"position: [{x:.4f}, {y:.4f}, {z + height:.4f}]"
    return f"{{type: {goal_type}, {TIP}, {place}, touches: [{touches}]}}"


def before_the_shelf(chance, item):
    """Return goals after which the arm is above an item."""
    x, y, _ = item.position
    return [
        f"{{type: go_to, base: [{x - 0.515:.4f}, {y:.4f}, 0]}}",
        "{type: grip, width: 0.09, force: 15}",
        tip("move_to_pose", item, chance.uniform(0.2, 0.3)),
    ]


def in_the_shelf(chance, item):
    """Return goals after which the open gripper is around an item, more or less deep."""
    depth = chance.uniform(0.11, 0.16)
    return [*before_the_shelf(chance, item), tip("move_linear", item, depth, item.name)]


def holding(chance, item):
    """Return goals after which the gripper holds an item, still on its board or just above it."""
    lift = chance.choice([0.0, chance.uniform(0.005, 0.1)])
    grip = f"{{type: grip, width: 0, force: 15, touches: [{item.name}]}}"
    up = [tip("move_linear", item, 0.105 + lift, item.name)] if lift else []
    down = tip("move_linear", item, 0.105, item.name)
    return [*before_the_shelf(chance, item), down, grip, *up]


def folded(chance, _):
    """Return goals after which the arm is folded, but not as it is at rest."""
    off = {
        "shoulder_pan_joint": chance.uniform(-0.4, 0.4),
        "elbow_joint": chance.uniform(-0.5, -0.25),
        "wrist_3_joint": chance.uniform(-0.5, 0.5),
    }
    angles = {joint: q + off.get(joint, 0.0) for joint, q in TUCK.items()}
    return [f"{{type: move_joints, joints: {flow(angles)}}}"]


def flow(joints):
    return "{" + ", ".join(f"{joint}: {q!r}" for joint, q in joints.items()) + "}"


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("stop", [before_the_shelf, in_the_shelf, holding, folded])
def test_an_arm_goes_back_to_rest_from_where_a_run_has_stopped(tmp_path, stop, seed):
    chance = random.Random(f"{stop.__name__} {seed}")
    item = item_of(seed, chance)
    touches = item.name if stop in {in_the_shelf, holding} else ""
    place = f"joints: {flow(TUCK)}"
    if stop is holding:
        # Tucked in, what is held would be in the chassis.
        place = "tip: grasp, position: [0.45, 0, 0.6], rpy: [3.141592653589793, 0, 0]"
    rest = f"{{type: back_to_rest, {place}, touches: [{touches}]}}"
    goals = f"goals.params.goals=[{', '.join([*stop(chance, item), rest])}]"
    overrides = (goals, f"plant.params.stock.seed={seed}", "duration=60s")
    result = store(tmp_path, *overrides, scenario="store/spiral")
    recording = Recording(result.recording)
    assert result.exit_code == 0, result.reason
    assert "back at rest" in texts(recording, "goals/events")[-1]
    state = last(recording, "plant/joint_state")
    if stop is not holding:
        assert state.position == pytest.approx(list(TUCK.values()), abs=2e-3)
    assert max(map(abs, state.velocity)) < 0.01
    assert last(recording, "plant/gripper").holding is (stop is holding)
    assert hardest(recording, item.name) < MOST


def hardest(recording, held):
    """Return the largest force on anything but the ground, and what is held between the pads [N]."""
    return max(
        force
        for _, contacts in recording.messages("plant/contacts")
        for pair, force in zip(contacts.pairs, contacts.force, strict=True)
        if not GROUND.intersection(pair) and not (held in pair and PADS.intersection(pair))
    )
