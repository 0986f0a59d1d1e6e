"""Failed sales: an emergency stop, one sentence with its cause, and a run that has failed."""

import itertools
import re

import pytest
from support.services.mission_sale import sell
from support.services.mission_store import FakeStore, shelf_a

from stepbus_schemas import GripperState

GOODS = (("cola", 2), ("cola", 3), ("water", 4))
REST = "; everything is at rest"
DARK = ("order", 0)


def failed(store, **params):
    result = sell(store, **params)
    assert result.goals[-1].type == "stop"
    assert result.error == result.errors[-1]
    assert result.summary.splitlines()[-1] == result.error
    assert not result.end
    return result.error


ONE = {"orders": [{"item": "cola_a1_3"}]}
TWICE = {("down", 1): "collision", ("down", 2): "collision"}
CAUSES = [
    ({"slips": 9}, {}, "lifting: slipped", "after 2 attempts"),
    ({"empty_grips": 9}, {"attempts": 1}, "grasping: not held", "after 1 attempt"),
    ({"fails": {("down", 1): "invalid"}}, {}, "moving down: invalid", "as the test wants it"),
    ({"fails": TWICE}, {}, "moving down: collision", "after 2 attempts"),
    ({"fails": {("home", 1): "jammed"}}, {}, "driving home: jammed", "as the test wants it"),
    ({"drops": (("home", 1),)}, {}, "driving home: dropped", "width 0.000 m"),
    ({"hidden": ("cola_a1_2", "cola_a1_3")}, {}, "no cola is left", "0 sold, 2 missing"),
    ({"hidden": ("cola_a1_3",)}, ONE, "cola_a1_3 is not there", "0 sold, 1 missing"),
    ({"hidden": ("cola_a1_3",), "covered": 0.8}, ONE, "cola_a1_3 is hidden", "0 sold, 0 missing, 1 hidden"),
    ({}, {"opening": 0.06}, "too wide, 0.066 m", "opens to 0.060 m"),
    ({"dark": DARK}, {}, "searching for it: the camera shows", "for 3 s above the shelf"),
    ({"dark": ("approach", 1)}, {}, "close up: the camera shows", "for 3 s above the shelf"),
    ({"silent": (("drive", 1),)}, {}, "does not answer: goal 1", "no status after 2 s"),
    ({"endless": (("inspect", 1),)}, {"waits": {"motion": 5}}, "not done, goal 3", "still running after 5 s"),
    ({"place_shift": 0.0142}, {}, "verifying its pose: misplaced", "14.2 mm"),
    ({"tips": True}, {}, "verifying its pose: not upright", "tilted by 86°"),
    ({"pushes": {("down", 1): ("water_a1_4", 0.0031)}}, {}, "verifying", "water_a1_4 was moved by 3.1 mm"),
    ({"seen_width": 0.03}, {"attempts": 1}, "grasping: not held", "0.030 m instead of 0.066 m"),
    ({"fails": {("inspect", 1): "as_the_test"}}, {}, "moving above", "as the test wants it"),
    ({"fails": {("park", 1): "no_plan"}}, {}, "tucking the arm in", "no plan, as the test wants it"),
]  # fmt: skip


@pytest.mark.parametrize(("faults", "params", "cause", "detail"), CAUSES)
def test_a_failure_is_one_sentence_with_its_cause(faults, params, cause, detail):
    sentence = failed(FakeStore(shelf_a(*GOODS), **faults), **params)
    assert cause in sentence
    assert detail in sentence
    assert sentence.endswith(REST)


def test_what_is_held_is_kept_in_an_emergency_stop():
    store = FakeStore(shelf_a(*GOODS), fails={("home", 1): "jammed"})
    failed(store)
    assert store.held == "cola_a1_2"
    assert [goal.width for goal in store.goals if goal.type == "grip"] == [0.09, 0.0]


def test_a_base_that_does_not_come_to_rest_is_named():
    store = FakeStore(shelf_a(*GOODS), fails={("drive", 1): "jammed"}, drifts=True)
    assert "10 s, the base moves at 0.050 m/s" in failed(store)


def test_a_controller_that_does_not_answer_the_stop_is_named():
    store = FakeStore(shelf_a(*GOODS), silent=(("drive", 1), ("stop", 1)))
    assert failed(store).endswith("10 s, the controller does not answer")


def test_a_stop_that_fails_is_named():
    store = FakeStore(shelf_a(*GOODS), fails={("drive", 1): "jammed", ("stop", 1): "not_settled"})
    assert "10 s, the controller reports failed" in failed(store)


def test_the_sales_before_a_failure_are_in_the_summary():
    store = FakeStore(shelf_a(*GOODS), fails={("drive", 2): "jammed"})
    result = sell(store, orders=["cola", "water"])
    assert "cola_a1_2" in result.summary.splitlines()[1]
    assert "1 of 2 sales in " in result.summary
    assert result.error.startswith("sale 2 (water_a1_4) failed")
    assert "jammed" in result.error


def test_a_sale_fails_only_after_all_approaches():
    blocked = {("down", number): "blocked" for number in range(1, 9)}
    sentence = failed(FakeStore(shelf_a(*GOODS), fails=blocked))
    assert "moving down: blocked" in sentence
    assert "after 8 approaches" in sentence


def test_an_order_that_is_sold_out_is_left_out_and_the_others_are_sold():
    result = sell(FakeStore(shelf_a(*GOODS)), orders=["cola", "cola", "cola", "water"])
    reason = "shelf empty, no cola is left; 2 sold, 0 missing"
    assert result.end == f"3 of 4 sales are done; no cola: {reason}"
    (warning,) = [event.text for event in result.events if event.level == "warning"]
    assert f"sale 3 (cola): {reason}" in warning.splitlines()
    rows = [line.split()[:2] for line in result.summary.splitlines()[1:5]]
    assert rows == [["1", "cola_a1_2"], ["2", "cola_a1_3"], ["3", "cola"], ["4", "water_a1_4"]]
    assert f"not sold: {reason}" in result.summary.splitlines()[3]


def test_the_table_lists_the_order_that_failed_and_those_that_were_not_tried():
    store = FakeStore(shelf_a(*GOODS), fails={("drive", 2): "jammed"})
    lines = sell(store, orders=["cola", "water", "cola"]).summary.splitlines()
    assert lines[2].split()[:5] == ["2", "water_a1_4", "not", "sold:", "failed"]
    assert lines[3].split(maxsplit=2) == ["3", "cola", "not sold: not tried"]


@pytest.mark.parametrize(
    ("column", "by"), [(9, 0.0031), (3, 0.3)], ids=["far from the robot", "faster than the robot"]
)
def test_an_item_that_others_move_fails_no_sale(column, by):
    store = FakeStore(
        shelf_a(("cola", 2), ("water", column)),
        pushes={("down", 1): (f"water_a1_{column}", by)},
        feels=True,
    )
    result = sell(store)
    assert result.end == "1 of 1 sales are done"
    text = f"water_a1_{column} was moved by {by * 1e3:.1f} mm, not by the robot"
    assert [event.text for event in result.events if event.level == "warning"] == [text]
    assert "other items moved up to 0.0 mm" in result.summary


def test_a_short_loss_of_the_grip_is_no_failure():
    store = FakeStore(shelf_a(*GOODS))
    gripper, calls = store.gripper, itertools.count()

    def flickers():
        state = gripper()
        is_lost = store.sent.get("home") and next(calls) < 3
        return GripperState(width=state.width, force=0.0, holding=False) if is_lost else state

    store.gripper = flickers
    assert sell(store).end
    assert next(calls) > 3


def test_detections_in_an_unknown_frame_are_refused():
    result = sell(FakeStore(shelf_a(*GOODS), frame="chasis"))
    assert "'chasis'; did you mean 'chassis'?" in result.error


def test_with_an_item_the_arm_goes_back_to_where_it_carries_it():
    empty = sell(FakeStore(shelf_a(*GOODS), fails={("inspect", 1): "jammed"}), recover=True)
    held = sell(FakeStore(shelf_a(*GOODS), fails={("home", 1): "jammed"}), recover=True)
    assert (bool(empty.goals[-1].joints), empty.goals[-1].position) == (True, None)
    goal = held.goals[-1]
    assert (goal.type, goal.joints, goal.frame) == ("back_to_rest", [], "")
    assert (goal.position, goal.touches) == ((0.45, 0.0, 0.6), ["cola_a1_2"])


def test_with_a_jammed_arm_nothing_is_tried_again():
    store = FakeStore(shelf_a(*GOODS), fails={("down", 1): "arm_jammed"})
    assert "moving down: arm jammed" in failed(store)
    assert [goal.type for goal in store.goals][-2:] == ["move_linear", "stop"]


@pytest.mark.parametrize(
    ("cause", "recovers"), [("jammed", True), ("arm_jammed", False), ("no_plan", False)]
)
def test_the_arm_goes_back_to_rest_only_while_nobody_is_missing(cause, recovers):
    result = sell(FakeStore(shelf_a(*GOODS), fails={("drive", 1): cause}), recover=True)
    assert ("back_to_rest" in [goal.type for goal in result.goals]) is recovers


@pytest.mark.parametrize("opens", [False, True])
def test_fingers_that_do_not_move_are_not_tried_again(opens):
    where = ("release", 1) if opens else ("close", 1)
    store = FakeStore(shelf_a(*GOODS), fails={where: "stuck"}, slips=1)
    assert f"{'releasing it' if opens else 'closing the gripper'}: stuck" in failed(store)
    assert [goal.type for goal in store.goals][-2:] == ["grip", "stop"]


STOPPABLE = [
    ("drive", 1), ("inspect", 1), ("down", 1), ("close", 1), ("lift", 1), ("home", 1),
    ("place", 1), ("up", 1), ("park", 1), ("depart", 1), ("fold", 1), ("reach", 1), ("return", 1),
    ("bring", 1),
]  # fmt: skip


@pytest.mark.parametrize("where", STOPPABLE, ids=lambda where: where[0])
def test_after_an_emergency_stop_the_sale_goes_on(where):
    together = where[0] in ("depart", "fold", "reach", "return", "bring")
    store = FakeStore(shelf_a(*GOODS), stops={where: 2.5})
    result = sell(store, together=together)
    assert "1 of 1 sales are done" in result.end
    text = "\n".join(event.text for event in result.events)
    assert re.search(r"emergency stop by a guard at \d+\.\d\d s", text)
    assert "released by a nurse after 2.50 s" in text
    # Nothing is commanded meanwhile, and each goal comes once more.
    undisturbed = sell(FakeStore(shelf_a(*GOODS)), together=together)
    assert len(result.goals) > len(undisturbed.goals)


def test_nothing_is_commanded_in_an_emergency_stop():
    store = FakeStore(shelf_a(*GOODS), stops={("drive", 1): 2.5})
    sent = []
    carry_out = store.carry_out

    def watched(goal, state):
        sent.append(store.stop.active)
        carry_out(goal, state)

    store.carry_out = watched
    sell(store)
    assert sent
    assert not any(sent)


def test_an_emergency_stop_that_is_not_released_ends_the_run_with_its_sentence():
    store = FakeStore(shelf_a(*GOODS), stops={("drive", 1): 1e9})
    result = sell(store, waits={"release": 5.0})
    assert result.error.startswith("sale 1 (cola_a1_2) failed")
    assert result.error.endswith("not released for 5 s" + REST)
    assert [goal.type for goal in result.goals][-1] == "go_to"


def test_a_base_that_rolls_on_in_an_emergency_stop_is_named():
    store = FakeStore(shelf_a(*GOODS), stops={("drive", 1): 1e9}, drifts=True)
    assert "the base moves at 0.050 m/s" in sell(store, waits={"release": 5.0}).error


@pytest.mark.parametrize("where", ["drive", "down", "home", "place"])
def test_a_robot_that_is_overturned_stops_and_says_so(where):
    store = FakeStore(shelf_a(*GOODS), overturns=((where, 1),), feels=True)
    text = failed(store)
    assert re.search(r"92°; at \d+\.\d\d s, chassis touches crate_box with 812\.4 N; ", text)
    assert "floor" not in text
    assert text.count("the robot is tilted by 92°") == 2
    assert [goal.type for goal in store.goals][-1] == "stop"
