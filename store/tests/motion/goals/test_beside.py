"""The arm beside a base that drives: together, on the last stretch, or while the base stands."""

import numpy as np
import pinocchio as pin
import pytest
from support.services.mobile import DT, JOINTS, READY, Robot, config

from stepbus_schemas import Plan

HOME = (4.0, 0.0, 0.0)


@pytest.fixture
def robot(tmp_path):
    return Robot(config(tmp_path, plans=True))


def answer(robot, **fields):
    """Answer the latest request: a route, or a path of one second that ends where it has to."""
    request = robot.requests[-1]
    robot.step(plan=reply(request, **fields))
    return request


def reply(request, **fields):
    """Return the answer to a request, see `answer`."""
    if request.base is not None:
        fields = {"route": [(0.5, 0.0, 0.0), HOME], **fields}
    elif "cause" not in fields:
        start, goal = np.array(request.start), np.array(request.goal)
        shares = [0.0, 0.5, 1.0]
        fields = {
            "times": shares,
            "position": [(start + s * (goal - start)).tolist() for s in shares],
            "velocity": [(v * (goal - start)).tolist() for v in (0.0, 1.5, 0.0)],
        }
    return Plan(id=request.id, **fields)


def set_off(robot):
    """Send the base on its way together with the arm; return the request of the arm."""
    robot.start(0, "go_together", base=HOME)
    answer(robot)
    robot.start(1, "move_joints", joints=["pan"], values=[0.3], base=HOME)
    robot.run(0.1)
    return robot.requests[-1]


def test_the_base_stays_until_a_path_of_the_arm_is_known_and_both_move_together(robot):
    request = set_off(robot)
    assert (robot.x, robot.states(0), robot.states(1)) == (
        0.0, ["accepted", "running"], ["accepted", "running"],
    )  # fmt: skip
    xs = [x for x, _, _ in request.bases]
    assert (xs[-1], max(xs)) == (0.0, pytest.approx(1.2, abs=0.1))
    answer(robot)
    robot.run(0.7)
    assert robot.x > 0.02
    assert 0.0 < robot.q[JOINTS.index("pan")] - READY[JOINTS.index("pan")] < 0.3
    robot.run(3.0)
    assert robot.states(1)[-1] == "succeeded"
    assert robot.states(0) == ["accepted", "running"]
    robot.run(10.0)
    assert (robot.states(0)[-1], robot.x) == ("succeeded", pytest.approx(4.0, abs=2e-3))


def test_where_no_path_is_free_beside_the_base_the_arm_moves_first(robot):
    set_off(robot)
    answer(robot, cause="no_path", text="a shelf")
    robot.run(0.1)
    assert (robot.requests[-1].bases, robot.x) == ([], 0.0)
    answer(robot)
    robot.run(0.7)
    assert robot.x == 0.0
    robot.run(14.0)
    assert (robot.states(1)[-1], robot.states(0)[-1]) == ("succeeded", "succeeded")


def go_and_reach(robot):
    """Let the arm reach a pose on arrival; return the request for that."""
    set_off(robot)
    answer(robot)
    robot.run(3.7)
    pose = robot.place("grasp")
    x, y, z = pose.translation.tolist()
    turn = tuple(pin.Quaternion(pose.rotation).coeffs().tolist())
    goal = {"position": (HOME[0] + x, y, z - 0.05), "orientation": turn, "frame": "odometry"}
    robot.start(2, "move_to_pose", tip="grasp", base=HOME, **goal)
    robot.run(0.1)
    return robot.requests[-1]


def test_the_arm_reaches_out_only_on_the_last_stretch_of_the_route(robot):
    request = go_and_reach(robot)
    xs = [x for x, _, _ in request.bases]
    assert (xs[-1], min(xs)) == (pytest.approx(4.0, abs=5e-3), pytest.approx(3.2, abs=0.1))
    answer(robot)
    before = robot.q.copy()
    while robot.x < 3.1:
        robot.step()
    assert np.array_equal(robot.q, before)
    while robot.x < 3.7:
        robot.step()
    assert np.abs(robot.q - before).max() > 0.01
    robot.run(3.0)
    assert (robot.states(2)[-1], robot.states(0)[-1]) == ("succeeded", "succeeded")


def test_a_path_that_is_blocked_before_the_arm_moves_is_not_taken(robot):
    request = go_and_reach(robot)
    answer(robot)
    robot.run(0.3)
    before = robot.q.copy()
    robot.step(plan=Plan(id=request.id, cause="blocked", text="somebody stands there"))
    while robot.states(0)[-1] != "succeeded":
        robot.step()
    robot.run(0.1)
    assert (robot.requests[-1].bases, robot.q) == ([], pytest.approx(before))
    answer(robot)
    robot.run(3.0)
    assert robot.states(2)[-1] == "succeeded"


def test_where_no_path_is_free_on_arrival_the_arm_reaches_out_when_the_base_stands(robot):
    go_and_reach(robot)
    while robot.requests[-1].bases:
        answer(robot, cause="no_path", text="a shelf")
        robot.run(4 * DT)
        if robot.x > 3.99:
            break
    before = robot.q.copy()
    while robot.states(0)[-1] != "succeeded":
        robot.step()
    assert np.array_equal(robot.q, before)
    robot.run(0.1)
    assert robot.requests[-1].bases == []
    answer(robot)
    robot.run(2.0)
    assert robot.states(2)[-1] == "succeeded"


def test_a_base_that_fails_takes_the_arm_with_it(robot):
    go_and_reach(robot)
    robot.jammed = True
    robot.run(2.0)
    assert (robot.states(0)[-1], robot.states(2)[-1]) == ("failed", "failed")
    assert robot.news[-1].cause == "jammed"


def test_a_collision_of_either_stops_both(robot):
    set_off(robot)
    answer(robot)
    robot.run(0.6)
    robot.touching = [("hand", "pillar", 20.0, -0.001)]
    robot.run(3.0)
    assert (robot.states(0)[-1], robot.states(1)[-1]) == ("failed", "failed")
    assert "by odometry" in robot.news[-1].text
    assert {n.cause for n in robot.news if n.state == "failed"} == {"collision"}
    assert max(abs(robot.vx), np.abs(robot.v).max()) < 1e-5


def test_a_robot_that_touches_itself_stops_and_does_not_drive_away(robot):
    set_off(robot)
    answer(robot)
    robot.run(0.6)
    robot.touching = [("hand", "upper", 20.0, -0.001)]
    robot.step()
    robot.run(0.1)
    stood = robot.x
    robot.run(3.0)
    assert (robot.states(0)[-1], robot.states(1)[-1]) == ("failed", "failed")
    assert robot.news[-1].text.endswith("still touches it with 20.0 N")
    assert stood - 1e-3 < robot.x < stood + 0.03
    assert max(abs(robot.vx), np.abs(robot.v).max()) < 1e-5


def test_a_stop_stops_both(robot):
    set_off(robot)
    answer(robot)
    robot.run(0.6)
    robot.start(3, "stop")
    robot.run(1.0)
    assert (robot.states(0)[-1], robot.states(1)[-1], robot.states(3)[-1]) == (
        "cancelled", "cancelled", "succeeded",
    )  # fmt: skip
    assert abs(robot.vx) < 1e-4


def test_a_base_that_waits_for_an_arm_in_vain_gives_up(robot):
    robot.start(0, "go_together", base=HOME)
    answer(robot)
    robot.run(6.0)
    end = robot.news[-1]
    assert (end.state, end.text, robot.x) == ("failed", "no goal of the arm has come for 5 s", 0.0)


def test_a_base_that_drives_in_steps_asks_for_the_rest_of_its_route_after_each(tmp_path):
    robot = Robot(config(tmp_path, plans=True, base_step=0.1))
    robot.start(0, "go_to", base=(0.35, 0.0, 0.0))
    stood = []
    for _ in range(4):
        request = robot.requests[-1]
        stood.append(request.base[0][0])
        robot.step(plan=Plan(id=request.id, route=[(0.2, 0.0, 0.0), (0.35, 0.0, 0.0)][-1:]))
        while robot.requests[-1] is request and robot.states(0)[-1] != "succeeded":
            robot.step()
    assert stood == pytest.approx([0.0, 0.1, 0.2, 0.3], abs=2e-3)
    assert (robot.states(0)[-1], robot.x) == ("succeeded", pytest.approx(0.35, abs=2e-3))


def test_a_goal_of_the_base_that_is_refused_stops_base_and_arm_all_the_same(robot):
    go_and_reach(robot)
    assert robot.vx > 0.1
    robot.start(3, "drive", by=float("nan"))
    robot.run(2.0)
    assert [robot.states(n)[-1] for n in (0, 2, 3)] == ["cancelled", "cancelled", "failed"]
    assert abs(robot.vx) < 1e-4


@pytest.mark.parametrize("joint", ["pan", "unknown"])
def test_a_base_whose_arm_has_failed_waits_for_another_goal_but_not_for_ever(robot, joint):
    robot.start(0, "go_together", base=HOME)
    answer(robot)
    robot.run(4.0)
    robot.start(1, "move_joints", joints=[joint], values=[0.3], base=HOME)
    robot.run(0.1)
    while robot.states(1)[-1] != "failed":
        answer(robot, cause="no_path", text="a shelf")
        robot.run(1.0)
    robot.run(3.0)
    assert robot.states(0)[-1] == "running"
    robot.run(3.0)
    end = robot.news[-1]
    assert (end.id, end.state, end.text) == (0, "failed", "no goal of the arm has come for 5 s")


def test_a_base_whose_arm_has_been_called_off_does_not_wait_for_ever(robot):
    set_off(robot)
    robot.start(2, "grip", width=0.05, force=10.0, base=HOME)
    robot.run(8.0)
    assert [robot.states(n)[-1] for n in (0, 1, 2)] == ["failed", "cancelled", "succeeded"]
    assert robot.x == 0.0


def test_the_arm_counts_on_the_whole_route_also_of_a_base_that_else_drives_in_steps(tmp_path):
    robot = Robot(config(tmp_path, plans=True, base_step=0.1))
    request = go_and_reach(robot)
    assert request.bases[-1][0] == pytest.approx(HOME[0], abs=5e-3)
    answer(robot)
    before = robot.q.copy()
    while robot.x < 3.1:
        robot.step()
    assert np.array_equal(robot.q, before)


def test_an_arm_that_fails_on_its_way_stops_the_base_too(robot):
    set_off(robot)
    answer(robot)
    robot.run(0.5)
    stuck = robot.q.copy()
    while robot.states(1)[-1] == "running":
        robot.step()
        robot.q, robot.v = stuck.copy(), np.zeros(6)
    robot.run(2.0)
    assert [robot.states(n)[-1] for n in (0, 1)] == ["failed", "failed"]
    assert robot.news[-1].cause == "arm_jammed"
    assert abs(robot.vx) < 1e-4


def test_an_arm_that_is_hindered_while_both_leave_moves_on_only_while_the_base_stands(robot):
    set_off(robot)
    answer(robot)
    robot.run(1.0)
    assert robot.vx > 0.1
    asked = len(robot.requests)
    robot.touching = [("hand", "pillar", 0.0, 0.0035)]
    robot.run(0.1)
    robot.touching = []
    while len(robot.requests) == asked:
        robot.step()
    # One question at a time: the planner forgets one when another one comes.
    robot.run(0.5)
    assert len(robot.requests) == asked + 1
    robot.step(plan=reply(robot.requests[asked]))
    robot.step()
    assert len(robot.requests) == asked + 2
    robot.step(plan=reply(robot.requests[asked + 1]))
    stood = robot.x
    robot.run(0.7)
    assert (robot.vx, robot.x) == pytest.approx((0.0, stood), abs=2e-3)
    while robot.states(1)[-1] != "succeeded":
        robot.step()
        assert abs(robot.x - stood) < 2e-3
    robot.run(12.0)
    assert (robot.states(0)[-1], robot.x) == ("succeeded", pytest.approx(4.0, abs=2e-3))
