"""What goes wrong in the store: each failure has its sentence, and everything comes to rest."""

from dataclasses import dataclass

import numpy as np
import pytest
from support.runs.store import last, moves, store, texts

from stepbus_orchestrator.errors import ExitCode, ScenarioError
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.scenario.load import load

pytestmark = pytest.mark.slow

ITEM = "cola_a1_1"
"""What is gone for when a cola is ordered."""

FAILED = f"sale 1 ({ITEM}) failed while "
STILL = "; everything is at rest"
NO_OTHER_MOVED = 2e-3
"""[m]"""

ONCE = "mission.params.attempts=1"


def script(*actions):
    return f"plant.params.script=[{', '.join(f'{{{action}}}' for action in actions)}]"


def at(seconds, scenario="store/truth"):
    """Return the step of a time, for faults."""
    return round(seconds * 1e9 / load(scenario).step_ns)


def assert_at_rest(recording):
    """Arm and base stand at the end of the recording."""
    joints, base = last(recording, "plant/joint_state"), last(recording, "plant/odometry")
    assert np.abs(joints.velocity).max() < 0.01, joints
    assert abs(base.vx) < 0.005, base
    assert abs(base.wz) < 0.01, base


def assert_no_other_item_moved(recording, *besides):
    others = {name: way for name, way in moves(recording).items() if name not in besides}
    assert max(others.values(), default=0.0) < NO_OTHER_MOVED, others


@dataclass(frozen=True, kw_only=True)
class Failure:
    """What is different in a run, and the sentence that has to come of it, in parts."""

    overrides: tuple[str, ...]
    told: tuple[str, ...]
    scenario: str = "store/truth"


FAILURES = {
    "too heavy": Failure(
        overrides=("plant.params.stock.types.cola.mass=9", ONCE),
        told=(f"{FAILED}lifting: slipped, what was held at 66.", "after 1 attempt", STILL),
    ),
    "too slippery": Failure(
        overrides=("plant.params.stock.types.cola.friction=0.05",),
        told=(f"{FAILED}lifting: slipped, what was held at 66.", "after 2 attempts", STILL),
    ),
    "missing": Failure(
        overrides=(
            f"mission.params.orders=[{{item: {ITEM}}}]",
            script(f"at: 3s, body: {ITEM}, position: [-4, 3, 0.0]"),
        ),
        told=(f"{FAILED}choosing an item: shelf empty, {ITEM} is not there; 0 sold, 1 miss", STILL),
    ),
    "out of reach": Failure(
        overrides=("mission.params.orders=[{item: water_a1_4}]", "mission.params.stand=1.05"),
        told=("sale 1 (water_a1_4) failed while moving above its position: unreachable", STILL),
    ),
    "nothing of a kind": Failure(
        overrides=("plant.params.stock.missing=[cola]",),
        told=(
            "sale 1 (cola) failed while choosing an item: shelf empty, no cola is",
            STILL,
        ),
    ),
    "shelf empty": Failure(
        overrides=("plant.params.stock.fill=0",),
        told=("sale 1 (cola) failed while choosing an item: shelf empty, no cola", STILL),
    ),
    "gripper without force": Failure(
        overrides=("plant.params.effort.left_finger=0", "plant.params.effort.right_finger=0"),
        told=(f"{FAILED}opening the gripper: stuck, the fingers have not moved: ", STILL),
    ),
    "jammed wheel": Failure(
        overrides=(script("at: 1.5s, jam: left_wheel"),),
        told=(f"{FAILED}driving to the shelf: jammed, ", "the left wheel rolls at 0.0", STILL),
    ),
    "dead camera": Failure(
        scenario="store",
        overrides=(script("at: 3s, camera: camera"),),
        told=(f"{FAILED}searching for it: the camera shows nothing: no detections for 3 s", STILL),
    ),
}


@pytest.mark.parametrize("name", FAILURES)
def test_a_failure_has_its_sentence_and_everything_comes_to_rest(name, tmp_path):
    failure = FAILURES[name]
    result = store(tmp_path, *failure.overrides, scenario=failure.scenario)
    recording = Recording(result.recording)
    assert (result.exit_code, result.participant) == (ExitCode.FAULT, "mission"), result.reason
    assert all(part in result.reason for part in failure.told), result.reason
    assert_at_rest(recording)
    assert_no_other_item_moved(recording, ITEM)


def test_a_grip_without_force_is_refused_before_anything_moves(tmp_path):
    with pytest.raises(ScenarioError, match="must be a number above 0, not 0"):
        store(tmp_path, "mission.params.force=0")


@pytest.mark.parametrize(
    ("seconds", "doing"),
    [(1.6, "moving above its position"), (10.8, "moving above the outlet")],
)
def test_without_a_planner_the_mission_says_so_and_everything_comes_to_rest(
    seconds, doing, tmp_path
):
    result = store(tmp_path, f"faults=[kill planner at {at(seconds)}]")
    assert (result.exit_code, result.participant) == (ExitCode.DIED, "planner")
    assert "was killed by SIGKILL" in result.reason
    assert f"{FAILED}{doing}: no plan, the planner has failed{STILL}" in result.reason
    assert_at_rest(Recording(result.recording))


@pytest.mark.parametrize("seconds", [2.0, 10.8])
def test_without_a_mission_base_and_arm_are_brought_to_rest(seconds, tmp_path):
    result = store(tmp_path, f"faults=[kill mission at {at(seconds)}]")
    assert (result.exit_code, result.participant) == (ExitCode.DIED, "mission")
    assert "its commands were held from step" in result.reason
    assert result.reason.endswith("and the robot came to rest")
    assert_at_rest(Recording(result.recording))


def test_without_perception_the_mission_says_so_and_everything_comes_to_rest(tmp_path):
    result = store(tmp_path, f"faults=[kill perception at {at(2.0)}]")
    assert (result.exit_code, result.participant) == (ExitCode.DIED, "perception")
    assert f"perception has failed{STILL}" in result.reason
    assert_at_rest(Recording(result.recording))


@pytest.mark.parametrize("who", ["mission", "planner"])
def test_a_fault_at_full_speed_stops_the_base_within_a_decimetre(who, tmp_path):
    step = at(2.0)
    result = store(tmp_path, f"faults=[kill {who} at {step}]")
    rows = list(Recording(result.recording).messages("plant/odometry"))
    before = next(state for k, state in rows if k == step)
    after = rows[-1][1]
    assert before.vx > 0.45
    assert np.hypot(after.x - before.x, after.y - before.y) < 0.1
    stood = next(k for k, state in rows if k > step and abs(state.vx) < 0.02)
    assert (stood - step) * 0.016 < 0.4


@pytest.mark.parametrize("seconds", [2.0, 10.8])
def test_without_a_controller_base_and_arm_are_braked(seconds, tmp_path):
    result = store(tmp_path, f"faults=[kill controller at {at(seconds)}]")
    recording = Recording(result.recording)
    assert (result.exit_code, result.participant) == (ExitCode.DIED, "controller")
    assert "its commands were held" in result.reason
    assert "came to rest" in result.reason
    assert_at_rest(recording)
    assert_no_other_item_moved(recording, ITEM)


APART = "mission.params.together=false"
"""The arm moves while the base stands, so that it is known when."""

POST_ASIDE = "body: pillar, position: [1.9, 0.5, 0]"
"""In the straight path above the item, with room around it."""

POST_AWAY = "at: 11s, body: pillar, position: [1.9, 0.6, 0]"
"""Back where it was; straight down to the item the arm would touch it."""

POST_ON_ITEM = "body: pillar, position: [2.015, 0.36, 0.38]"
"""Where the gripper has to go, whichever path it takes."""


def assert_nothing_was_touched(recording, link):
    hit = [
        (pair, force)
        for _, contacts in recording.messages("plant/contacts")
        for pair, force in zip(contacts.pairs, contacts.force, strict=True)
        if link in pair and force > 0.0
    ]
    assert not hit


def arm_plans(recording):
    """Return what the planner says of the arm's plans, without their numbers."""
    plans = [text.split(": ", 1)[1] for text in texts(recording, "planner/events")]
    return [plan for plan in plans if not plan.startswith("base: ")]


def test_around_what_blocks_the_first_way_another_one_is_taken(tmp_path):
    result = store(tmp_path, script(f"at: 2s, {POST_ASIDE}", POST_AWAY), APART)
    recording = Recording(result.recording)
    assert "mission: 1 of 1 sales are done" in result.reason
    assert arm_plans(recording)[0].startswith("detour of ")
    assert_nothing_was_touched(recording, "pillar_post")


def test_what_comes_into_the_way_during_the_motion_is_gone_around(tmp_path):
    result = store(tmp_path, script(f"at: 4.8s, {POST_ASIDE}", POST_AWAY), APART)
    recording = Recording(result.recording)
    assert "mission: 1 of 1 sales are done" in result.reason
    plans = arm_plans(recording)
    assert plans[0].startswith("straight path of ")
    blocked = next(n for n, plan in enumerate(plans) if plan.startswith("pillar_post blocks the"))
    assert plans[blocked + 1].startswith("detour of ")
    # The arm's own sensors see the post first; once the arm stands, the planner knows it, too.
    said = [text for text in texts(recording, "mission/events") if "asked for another path" in text]
    (text,) = said
    assert text.startswith(f"sale 1 ({ITEM}): ")
    assert "asked for another path (1 of 3)" in text
    assert_nothing_was_touched(recording, "pillar_post")


def test_where_there_is_no_path_the_run_fails_with_everything_at_rest(tmp_path):
    result = store(tmp_path, script(f"at: 5.2s, {POST_ON_ITEM}"), APART)
    recording = Recording(result.recording)
    assert (result.exit_code, result.participant) == (ExitCode.FAULT, "mission"), result.reason
    assert f"{FAILED}moving above its position: no path, " in result.reason
    assert "pillar_post" in result.reason
    assert result.reason.count(STILL) == 1
    assert_at_rest(recording)
    assert_nothing_was_touched(recording, "pillar_post")


STOPS = {"approaching": 4.9, "bringing": 12.5}


@pytest.mark.parametrize("at_s", STOPS.values(), ids=STOPS)
def test_after_an_emergency_stop_the_sale_goes_on_without_a_jump(tmp_path, at_s):
    stop = script(f"at: {at_s}s, emergency_stop: true", f"at: {at_s + 1}s, emergency_stop: false")
    result = store(tmp_path, stop, scenario="store")
    assert "mission: 1 of 1 sales are done" in result.reason
    recording = Recording(result.recording)
    period = load("store").step_ns * 1e-9
    first, last_one = at_s / period + 2, (at_s + 1) / period
    for port in ("controller/arm", "controller/base", "controller/gripper", "mission/goal"):
        sent = [step for step, _ in recording.messages(port)]
        assert not [step for step in sent if first <= step < last_one], port
    joints = dict(recording.messages("plant/joint_state"))
    after, command = next(
        (step, row) for step, row in recording.messages("controller/arm") if step >= last_one
    )
    assert command.values == pytest.approx(joints[after].position, abs=1e-6)
    speeds = np.array([joints[after + k].velocity for k in range(40)])
    # Within the limit of acceleration, 3 rad/s².
    assert np.abs(np.diff(speeds, axis=0)).max() < 3.1 * period
    stood = np.array([joints[step].velocity for step in range(int(first) + 16, int(last_one))])
    assert np.abs(stood).max() < 0.01


def test_an_emergency_stop_that_is_not_released_is_what_the_run_says(tmp_path):
    stop = script("at: 11s, emergency_stop: true")
    result = store(tmp_path, stop, "mission.params.waits.release=2")
    assert result.exit_code == ExitCode.FAULT
    assert f"{FAILED}moving above the outlet" in result.reason
    assert f"not released for 2 s{STILL}" in result.reason
    assert_at_rest(Recording(result.recording))
