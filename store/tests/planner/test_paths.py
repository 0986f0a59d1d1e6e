"""What ways the planner finds, and why it finds none."""

import gc
import re
import weakref

import numpy as np
import pytest
from support.services.planner import (
    GOAL,
    PILLAR,
    START,
    WALL,
    answer,
    every_ms,
    scene_of,
    touched,
    write_arm,
)

from stepbus_store.planner.path_search import Search, find_paths

CAN_AHEAD = ("can", "cylinder 0.03 0.1", (0.95, 0.0, 0.5))
"""At the tip of the arm that is stretched out along x."""

SHELF = ("shelf", "box 0.2 0.2 0.02", (0.95, 0.0, 0.44))
"""Whose top the can stands on."""


def ahead(turn: float) -> list[float]:
    return [turn, 0.0, 0.0]


def test_where_nothing_is_in_the_way_it_goes_straight(tmp_path):
    plan, _ = answer(tmp_path)
    rows = np.array(plan.position)
    assert (plan.cause, plan.id) == ("", 1)
    assert plan.text.startswith("straight path of 2.00 rad in ")
    assert np.abs(rows[:, 1:]).max() < 1e-9
    assert np.all(np.diff(rows[:, 0]) >= 0)


def test_it_goes_around_a_pillar_and_touches_nothing_at_any_millisecond(tmp_path):
    plan, planner = answer(tmp_path, PILLAR)
    assert plan.text.startswith("detour of ")
    assert touched(planner, plan, PILLAR) == []


def test_velocity_and_acceleration_stay_within_their_limits(tmp_path):
    plan, _ = answer(tmp_path, PILLAR, velocity_limit=[1.0, 1.2, 1.4], acceleration_limit=2.0)
    velocity = np.diff(every_ms(plan), axis=0) / 1e-3
    assert np.all(np.abs(velocity) <= np.array([1.0, 1.2, 1.4]))
    assert np.abs(np.diff(np.array(plan.velocity), axis=0) / 0.016).max() <= 2.0


@pytest.mark.parametrize("things", [(), (PILLAR,)], ids=["straight", "detour"])
def test_acceleration_and_jerk_stay_within_their_limits_between_the_samples_too(tmp_path, things):
    plan, _ = answer(tmp_path, *things, acceleration_limit=3.0, jerk_limit=40.0)
    position = every_ms(plan)[::16]
    acceleration = np.diff(position, n=2, axis=0) / 0.016**2
    assert 2.0 < np.abs(acceleration).max() <= 3.0 + 1e-6
    assert 30.0 < np.abs(np.diff(acceleration, axis=0)).max() / 0.016 <= 40.0 + 1e-3
    shifted = np.diff(every_ms(plan)[5::16], n=3, axis=0) / 0.016**3
    assert np.abs(shifted).max() <= 1.1 * 40.0


def test_where_a_wall_is_in_the_way_it_says_after_how_many_checks_it_gave_up(tmp_path):
    plan, _ = answer(tmp_path, WALL, max_checks=1000)
    assert (plan.cause, plan.times) == ("no_path", [])
    assert 1000 <= int(plan.text.split()[-2]) <= 1300


@pytest.mark.parametrize("end", ["start", "goal"])
def test_a_start_or_goal_in_a_thing_is_refused_with_both_names(tmp_path, end):
    plan, _ = answer(tmp_path, PILLAR, request={end: ahead(0.0)})
    assert plan.cause == f"{end}_collides"
    assert plan.text == f"at the {end}, link_1 touches pillar (70.0 mm deep)"


def test_a_goal_closer_than_the_margin_is_reached(tmp_path):
    post = ("post", "box 0.1 0.1 1", (0.6, 0.074, 0.5))
    plan, planner = answer(tmp_path, post, request={"goal": ahead(0.0)})
    assert plan.cause == ""
    assert touched(planner, plan, post) == []


def test_what_may_be_touched_is_gone_through(tmp_path):
    plan, _ = answer(tmp_path, PILLAR, request={"touches": ["pillar"]})
    assert plan.text.startswith("straight path")


def test_a_held_thing_is_kept_off_what_the_empty_hand_passes(tmp_path):
    post = ("post", "box 0.04 0.04 1", (0.0, 1.0, 0.5))
    request = {"start": ahead(0.0), "goal": ahead(2.5), "touches": ["can"]}
    free, _ = answer(tmp_path, CAN_AHEAD, post, request=request)
    plan, planner = answer(tmp_path, CAN_AHEAD, post, request={**request, "held": "can"})
    assert free.text.startswith("straight path")
    assert plan.text.startswith("detour")
    assert touched(planner, plan, CAN_AHEAD, post, held="can") == []


def test_a_held_thing_may_leave_the_shelf_that_it_stands_on(tmp_path):
    request = {"start": ahead(0.0), "goal": ahead(1.0), "held": "can"}
    plan, _ = answer(tmp_path, CAN_AHEAD, SHELF, request=request)
    assert plan.text.startswith("straight path")


def test_a_held_thing_in_another_thing_is_named(tmp_path):
    request = {"start": ahead(0.0), "goal": ahead(1.0), "held": "can"}
    wall = ("wall", "box 0.1 0.1 1", (0.0, 0.99, 0.5))
    request["goal"] = ahead(np.pi / 2)
    plan, _ = answer(tmp_path, CAN_AHEAD, wall, request=request)
    assert plan.cause == "goal_collides"
    assert "can touches wall" in plan.text


def test_the_arm_does_not_go_through_itself(tmp_path):
    plan, _ = answer(tmp_path, request={"goal": [1.0, 2.6, 2.6]})
    assert plan.cause == "goal_collides"
    assert "link_0 touches link_2" in plan.text


@pytest.mark.parametrize(
    ("request_", "text"),
    [
        ({"start": [0.0]}, "start has 1 values, not 3 (one, two, three)"),
        ({"goal": [0.0, 3.0, 0.0]}, "goal: two at 3.000 rad is outside -2.600 to 2.600 rad"),
        ({"goal": [0.0, float("nan"), 0.0]}, "goal: two at nan rad is outside"),
        ({"held": "pilar"}, "the world has no link 'pilar'; did you mean 'pillar'?"),
        ({"touches": ["chassis"]}, "the world has no link 'chassis'"),
    ],
)
def test_a_request_of_no_use_is_refused_in_a_sentence(tmp_path, request_, text):
    plan, _ = answer(tmp_path, PILLAR, request=request_)
    assert plan.cause == "bad_request"
    assert plan.text.startswith(text)


def test_a_goal_at_the_start_is_a_plan_of_standing_still(tmp_path):
    plan, _ = answer(tmp_path, request={"goal": START})
    assert plan.position == [START, START]
    assert plan.times == [0.0, 0.016]


def test_weak_motors_make_it_slow_and_too_weak_ones_make_it_refuse(tmp_path):
    swing, durations = {"start": ahead(-0.3), "goal": ahead(0.3)}, []
    for effort in (100.0, 19.3):
        write_arm(tmp_path, effort, axis="0 1 0")
        plan, _ = answer(tmp_path, request=swing)
        durations.append(plan.times[-1])
    assert durations[1] > durations[0]
    write_arm(tmp_path, 10.0, axis="0 1 0")
    plan, _ = answer(tmp_path, request=swing)
    assert plan.cause == "not_holdable"
    assert "one needs 15.2 N·m" in plan.text


def test_what_is_carried_makes_it_slower_and_too_much_is_refused(tmp_path):
    write_arm(tmp_path, 25.0, axis="0 1 0")
    swing, durations = {"start": ahead(-0.3), "goal": ahead(0.3)}, []
    for load in (0.0, 0.4):
        plan, _ = answer(tmp_path, request={**swing, "load": load})
        durations.append(plan.times[-1])
    assert durations[1] > 1.05 * durations[0]
    plan, _ = answer(tmp_path, request={**swing, "load": 2.0})
    assert plan.cause == "not_holdable"


def test_a_check_outlives_the_scene_it_was_made_of(tmp_path):
    _, planner = answer(tmp_path, PILLAR)
    checker = scene_of(planner, START, PILLAR).checker([])
    gc.collect()
    assert [checker.is_free(np.array(ahead(x))) for x in (-1.0, 0.0, 1.0)] == [True, False, True]


def test_a_search_that_nobody_wants_any_more_ends_long_before_its_last_check():
    box = np.full(3, 3.0)
    search = Search(lower=-box, upper=box, max_checks=10**6, seed=1)
    checks = []

    def is_free(q):
        checks.append(q)
        return bool(abs(q[0]) > 0.2)

    start = np.array([1.0, 0.0, 0.0])
    assert find_paths(search, start, -start, is_free, lambda: len(checks) > 100) is None
    assert 100 < len(checks) < 10_000


def test_a_search_leaves_nothing_behind():
    box = np.full(3, 3.0)
    search = Search(lower=-box, upper=box, max_checks=10**4, seed=1)

    def is_free(q):
        return bool(abs(q[0]) > 0.2 or q[1] > 1.0)

    start, left = np.array([1.0, 0.0, 0.0]), weakref.ref(is_free)
    assert find_paths(search, start, -start, is_free, lambda: False) is not None
    del is_free
    gc.collect()
    assert left() is None


def check(folder, *things, path, at=None, **fields):
    rows = [ahead(turn) for turn in np.linspace(*path, 30).tolist()]
    request = {"start": at or rows[0], "goal": at or rows[0], "path": rows[1:], **fields}
    return answer(folder, *things, request=request)[0]


def test_a_free_path_is_answered_by_standing_still(tmp_path):
    plan = check(tmp_path, PILLAR, path=(-1.0, -0.5))
    assert plan.cause == ""
    assert plan.text.startswith("path is free, ")
    assert plan.position == [ahead(-1.0)] * 2


def test_a_path_that_touches_something_is_refused_with_the_links_and_where(tmp_path):
    plan = check(tmp_path, PILLAR, path=(-1.0, 1.0))
    assert plan.cause == "path_collides"
    assert re.match(r"0\.\d+ m from its start, link_\d", plan.text)


def test_a_path_keeps_a_small_margin(tmp_path):
    # The arm, 40 mm wide, ends at an angle of 0; its side is 20 mm from the x axis.
    near = ("post", "box 0.05 0.02 1", (0.6, 0.02 + 0.01 + 0.002, 0.5))
    assert check(tmp_path, near, path=(-1.0, 0.0)).cause == "path_collides"
    assert check(tmp_path, near, path=(-1.0, 0.0), touches=["post"]).cause == ""
    beyond = (*near[:2], (0.6, 0.02 + 0.01 + 0.0045, 0.5))
    assert check(tmp_path, beyond, path=(-1.0, 0.0)).cause == ""


def test_a_path_may_leave_what_it_touches_at_its_start(tmp_path):
    near = ("post", "box 0.05 0.02 1", (0.6, 0.02 + 0.01 - 0.001, 0.5))
    assert check(tmp_path, near, path=(0.0, -1.0)).cause == ""


def test_a_path_through_the_robot_itself_is_refused_with_the_links(tmp_path):
    rows = [[-1.0, fold, fold] for fold in np.linspace(0.0, 2.6, 40).tolist()]
    request = {"start": rows[0], "goal": rows[0], "path": rows[1:]}
    plan, _ = answer(tmp_path, request=request)
    assert plan.cause == "path_collides"
    assert re.search(r"link_\d .* link_\d", plan.text)


def test_what_follows_a_planned_motion_is_checked_too(tmp_path):
    path = [ahead(turn) for turn in np.linspace(1.0, -1.0, 60)[1:].tolist()]
    plan, _ = answer(tmp_path, PILLAR, request={"path": path})
    assert plan.cause == "path_collides"
    plan, _ = answer(tmp_path, PILLAR, request={"path": path[:10]})
    assert (plan.cause, plan.position[-1]) == ("", GOAL)


def test_a_path_of_other_joints_is_refused(tmp_path):
    plan, _ = answer(tmp_path, request={"goal": START, "path": [[0.0]]})
    assert (plan.cause, plan.text[:12]) == ("bad_request", "path point 0")
