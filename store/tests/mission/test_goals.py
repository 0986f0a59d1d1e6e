"""A mission that sends goals one after the other."""

import pytest

from stepbus.testing import Bench
from stepbus_participant import Config
from stepbus_schemas import GoalStatus, InputConfig, OutputConfig, RunError
from stepbus_store.goals import GoalSequence

TUCK = {"type": "move_joints", "joints": {"pan": 0.5}}
AROUND = {"centre": [0.45, 0.0, 0.3], "radius": [0.3, 0.1], "turns": 2, "rise": 0.2}
SPIRAL = {
    "type": "spiral", "tip": "grasp", "position": [0.45, 0.0, 0.6],
    "rpy": [3.141592653589793, 0, 0], "spiral": AROUND,
}  # fmt: skip


def mission(folder, *goals):
    config = Config(
        name="mission",
        step_ns=8_000_000,
        every=1,
        seed=0,
        folder=folder,
        inputs={"status": InputConfig(source="arm", port="status", type="GoalStatus/1")},
        outputs={"goal": OutputConfig(type="Goal/1"), "events": OutputConfig(type="Event/1")},
        params={"goals": list(goals)},
    )
    return Bench(GoalSequence, config)


def status(number, state, text=""):
    return GoalStatus(id=number, state=state, text=text)


def test_the_next_goal_is_sent_when_the_one_before_has_succeeded(tmp_path):
    bench = mission(tmp_path, SPIRAL, TUCK)
    first = bench.step(0)["goal"]
    assert (first.id, first.type, first.tip, first.spiral.radius) == (
        0,
        "spiral",
        "grasp",
        (0.3, 0.1),
    )
    assert first.orientation == pytest.approx((1.0, 0.0, 0.0, 0.0))
    accepted = bench.step(1, status=status(0, "accepted", "2 turns"))
    assert accepted["events"].text == "goal 1 of 2 (spiral): accepted, 2 turns"
    assert bench.step(2, status=status(0, "running")) == {}
    second = bench.step(3, status=status(0, "succeeded"))["goal"]
    assert (second.id, second.joints, second.values) == (1, ["pan"], [0.5])
    assert bench.end_reason is None
    bench.step(4, status=status(1, "succeeded"))
    assert bench.end_reason == "2 of 2 goals are done"


def test_a_goal_that_fails_ends_the_run_with_its_reason(tmp_path):
    bench = mission(tmp_path, TUCK)
    bench.step(0)
    with pytest.raises(RunError, match=r"goal 1 of 1 \(move_joints\) failed: pan is stuck"):
        bench.step(1, status=status(0, "failed", "pan is stuck"))
