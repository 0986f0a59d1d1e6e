"""A mobile manipulator with a planner: its plans, its routes, and what blocks them."""

import numpy as np
import pytest
from support.services.mobile import DT, Robot, config

from stepbus_schemas import Plan


def test_what_is_held_is_weighed_and_the_planner_hears_of_it(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    robot.thing, robot.mass = 0.066, 0.8
    robot.go(0, "grip", width=0.0, force=30.0)
    robot.run(1.0)
    robot.start(1, "move_joints", joints=["pan"], values=[0.3])
    assert robot.requests[0].load == pytest.approx(0.8, abs=0.02)
    # 1.5 times what a friction of 0.4 needs.
    assert robot.commands[-1]["gripper"].force == pytest.approx(14.7, abs=0.4)
    robot.go(2, "grip", width=0.09, force=30.0)
    robot.start(3, "move_joints", joints=["pan"], values=[0.3])
    assert robot.requests[-1].load == 0.0


def answered(request):
    """Return a plan that goes straight to what is asked for in a second."""
    times = np.linspace(0.0, 1.0, 51)
    share = 10 * times**3 - 15 * times**4 + 6 * times**5
    speed = 30 * times**2 - 60 * times**3 + 30 * times**4
    way = np.array(request.goal) - np.array(request.start)
    return Plan(
        id=request.id, times=times.tolist(),
        position=(np.array(request.start) + np.outer(share, way)).tolist(),
        velocity=np.outer(speed, way).tolist(),
    )  # fmt: skip


@pytest.fixture
def planned(tmp_path):
    """Return a robot on the way that a planner has found, 0.4 s after its start."""
    robot = Robot(config(tmp_path, plans=True))
    robot.start(0, "move_joints", joints=["pan"], values=[0.8])
    robot.step(plan=answered(robot.requests[0]))
    robot.run(0.4)
    assert abs(robot.v[0]) > 0.5
    return robot


def finish(robot):
    """Answer the second request, and return the states of the goal until it has ended."""
    robot.run(0.5)
    assert np.abs(robot.v).max() < 1e-9
    assert robot.requests[1].start == pytest.approx(robot.q, abs=1e-6)
    assert robot.requests[1].goal == robot.requests[0].goal
    robot.step(plan=answered(robot.requests[1]))
    robot.run(9.0)
    return robot.states(0)


def test_when_its_way_is_blocked_the_arm_stops_and_goes_on_by_another_one(planned):
    robot = planned
    robot.step(plan=Plan(id=robot.requests[0].id, cause="blocked", text="crate is in the way"))
    robot.step()
    assert robot.news[-1].text.endswith("asked for another path (1 of 3)")
    assert finish(robot) == ["accepted", "running", "running", "succeeded"]
    assert robot.q[0] == pytest.approx(0.8, abs=1e-3)


def test_what_comes_too_close_on_a_planned_way_is_gone_around(planned):
    robot = planned
    robot.touching = [("hand", "crate", 0.0, 0.003)]
    robot.step()
    assert "hand is 3.0 mm from crate; stops" in robot.warnings
    asked_again(robot)
    assert "stopped, backed off 50 mm, asked" in robot.news[-1].text
    assert finish(robot)[-1] == "succeeded"
    assert len(robot.requests) == 2


def asked_again(robot, seconds=3.0):
    """Run until the planner is asked for another path."""
    count = len(robot.requests)
    for _ in range(round(seconds / DT)):
        robot.step()
        if len(robot.requests) > count:
            return


class Post:
    """Stands where the hand of a robot gets after some path of its tip; the robot senses it."""

    def __init__(self, robot, ahead):
        self.robot, self.ahead, self.nearest = robot, ahead, ahead
        self.start, self.answered = robot.q[0], len(robot.requests)
        self.sense()

    def sense(self):
        # The arm only pans, and its hand is 0.9 m from the axis.
        gap = float(self.ahead - 0.9 * (self.robot.q[0] - self.start))
        self.nearest = min(self.nearest, gap)
        self.robot.touching = [("hand", "post", 0.0, gap)] if gap < 0.15 else []
        return gap

    def meet(self, seconds):
        """Run, and let the planner, which does not know the post, answer each question."""
        for _ in range(round(seconds / DT)):
            self.sense()
            open_requests = self.robot.requests[self.answered :]
            self.answered = len(self.robot.requests)
            answers = {"plan": answered(open_requests[-1])} if open_requests else {}
            self.robot.step(**answers)


def test_what_the_planner_does_not_know_is_left_and_not_gone_towards_twice(planned):
    robot = planned
    post = Post(robot, 0.14)
    post.meet(12.0)
    assert post.nearest > 2e-3
    end = robot.news[-1]
    assert (end.state, end.cause) == ("failed", "no_path")
    assert end.text.endswith("another path leads there again")
    assert len(robot.requests) == 2
    assert np.abs(robot.v).max() < 1e-9
    # What has stopped it before stops it again, in the next goal and from as near.
    near = post.sense()
    robot.start(1, "move_joints", joints=["pan"], values=[0.8])
    post.meet(12.0)
    assert robot.news[-1].state == "failed"
    assert post.nearest > min(near, 2e-3)


def test_what_comes_fast_on_a_planned_way_is_stopped_for_before_it_is_too_late(planned):
    robot = planned
    robot.touching = [("crate", "hand", 0.0, 0.1)]
    robot.step()
    assert len(robot.requests) == 1
    robot.touching = [("crate", "hand", 0.0, 0.08)]
    asked_again(robot)
    # It is far enough away to stay where it is.
    assert robot.news[-1].text.startswith("hand is 80.0 mm from crate; stopped")


@pytest.mark.parametrize(("gap", "requests"), [(0.0119, 1), (0.009, 2)])
def test_what_is_close_from_the_start_stops_the_arm_once_it_comes_closer(tmp_path, gap, requests):
    robot = Robot(config(tmp_path, plans=True))
    robot.touching = [("crate", "hand", 0.0, 0.012)]
    robot.step()
    robot.start(0, "move_joints", joints=["pan"], values=[0.8])
    robot.step(plan=answered(robot.requests[0]))
    robot.run(0.4)
    robot.touching = [("crate", "hand", 0.0, gap)]
    robot.step()
    robot.touching = []
    asked_again(robot, 0.5)
    assert len(robot.requests) == requests


def test_an_arm_does_not_start_towards_what_is_close_from_the_start(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    robot.step()
    post = Post(robot, 3e-3)
    robot.step()
    robot.start(0, "move_joints", joints=["pan"], values=[0.8])
    post.meet(9.0)
    assert post.nearest > 1e-3
    assert robot.news[-1].state == "failed"


def carrying(folder):
    """Return a robot that is on its way along a plan, with something in its gripper."""
    robot = Robot(config(folder, plans=True))
    robot.thing, robot.mass = 0.066, 0.8
    robot.go(0, "grip", width=0.0, force=30.0)
    robot.run(1.0)
    robot.start(1, "move_joints", joints=["pan"], values=[0.8])
    robot.step(plan=answered(robot.requests[0]))
    robot.run(0.4)
    return robot


def hardest_brake(robot):
    """Return the largest change of a joint's speed in the next 0.3 s [rad/s²]."""
    speeds = [robot.v.copy()]
    for _ in range(round(0.3 / DT)):
        robot.step()
        speeds.append(robot.v.copy())
    return np.abs(np.diff(speeds, axis=0)).max() / DT


@pytest.mark.parametrize(("gap", "hardest"), [(0.002, 15.0), (0.079, 7.5)])
def test_an_arm_that_holds_something_stops_as_hard_as_it_must(tmp_path, gap, hardest):
    robot = carrying(tmp_path)
    robot.touching = [("crate", "hand", 0.0, gap)]
    robot.step(plan=Plan(id=robot.requests[0].id, cause="blocked", text="crate is in the way"))
    assert hardest_brake(robot) == pytest.approx(hardest, rel=0.1)


def test_a_stop_that_keeps_what_is_held_gets_harder_once_it_is_too_weak(tmp_path):
    robot = carrying(tmp_path)
    robot.step(plan=Plan(id=robot.requests[0].id, cause="blocked", text="crate is in the way"))
    robot.run(2 * DT)
    robot.touching = [("crate", "hand", 0.0, 0.01)]
    assert hardest_brake(robot) == pytest.approx(15.0, rel=0.1)
    # The planner is asked anew, from where the arm stands now.
    assert robot.requests[-1].start == pytest.approx(robot.q, abs=1e-6)


def test_backing_off_ends_before_what_was_left_is_pressed_again(tmp_path):
    robot = Robot(config(tmp_path))
    robot.start(0, "move_joints", joints=["pan"], values=[2.0])
    robot.run(0.8)
    for touch in ((7.5, -0.001), (0.0, 0.02), (13.0, -0.001)):
        robot.touching = [("hand", "pillar", *touch)]
        robot.run(0.1)
    assert robot.news[-1].text.endswith("hand touches pillar with 13.0 N")
    robot.run(0.2)
    assert np.abs(robot.v).max() < 1e-9


def test_its_own_links_are_as_close_as_the_planner_has_checked_but_others_behind_them_count(
    planned,
):
    robot = planned
    robot.touching = [("hand", "upper", 0.0, 0.002)]
    robot.run(0.2)
    assert len(robot.requests) == 1
    robot.touching += [("crate", "hand", 0.0, 0.003)]
    robot.step()
    assert robot.warnings[-1] == "hand is 3.0 mm from crate; stops"


def test_what_is_touched_on_a_planned_way_is_left_first_and_then_gone_around(planned):
    robot = planned
    robot.touching = [("hand", "crate", 7.5, -0.001)]
    robot.step()
    touched = robot.place("grasp").translation.copy()
    robot.touching = []
    while len(robot.requests) < 2:
        robot.step()
    assert np.linalg.norm(robot.place("grasp").translation - touched) > 0.02
    assert "7.5 N; stopped, backed off 50 mm" in robot.news[-1].text
    assert finish(robot)[-1] == "succeeded"


def test_a_goal_is_given_other_ways_so_many_times_and_no_more(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    robot.start(0, "move_joints", joints=["pan"], values=[0.8])
    for requests in (2, 3, 4, 4):
        robot.step(plan=answered(robot.requests[-1]))
        robot.run(0.3)
        robot.step(plan=Plan(id=robot.requests[-1].id, cause="blocked", text="a cat"))
        robot.run(0.5)
        assert len(robot.requests) == requests
    end = robot.news[-1]
    assert (end.state, end.cause, end.text) == (
        "failed",
        "no_path",
        "a cat; stopped, after 3 other paths",
    )
    assert np.abs(robot.v).max() < 1e-9


def test_when_the_planner_has_failed_everything_stops_and_nothing_begins_again(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    robot.start(0, "drive", by=1.0)
    robot.run(1.0)
    robot.step(plan=Plan(id=0, cause="planner_failed", text="the planner has failed"))
    assert (robot.news[-1].state, robot.news[-1].cause) == ("failed", "no_plan")
    robot.run(2.0)
    assert abs(robot.vx) < 1e-3
    assert robot.go(1, "drive", by=-1.0).text == "the planner has failed"
    assert robot.go(2, "stop").state == "succeeded"


def go_and_meet_a_post(robot):
    """Drive along a planned route until a post is 5 mm ahead; return where it stood then."""
    robot.start(0, "go_to", base=(2.0, 0.0, 0.0))
    robot.step(plan=Plan(id=robot.requests[-1].id, route=[(2.0, 0.0, 0.0)]))
    robot.run(1.5)
    post = robot.x + 0.4
    while len(robot.requests) < 2 and robot.k < 2000:
        gap = post - robot.x
        robot.touching = [("chassis", "post", 0.0, gap)] if gap < 0.08 else []
        robot.step()
    return robot.x


def test_a_pose_is_gone_to_along_the_planners_route(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    robot.start(0, "go_to", base=(1.0, 0.0, 0.0), touches=["can"])
    request = robot.requests[-1]
    assert (request.base, request.touches) == (((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), ["can"])
    assert robot.x == 0.0
    robot.step(plan=Plan(id=request.id, route=[(0.5, 0.3, 0.0), (1.0, 0.0, 0.0)]))
    ys = []
    for _ in range(2000):
        robot.step()
        ys.append(robot.y)
    assert robot.news[-1].state == "succeeded"
    assert max(ys) == pytest.approx(0.3, abs=5e-3)
    assert (robot.x, robot.y) == pytest.approx((1.0, 0.0), abs=3e-3)


def test_before_something_on_its_route_the_base_stops_and_asks_for_another(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    stood = go_and_meet_a_post(robot)
    assert [news.state for news in robot.news] == ["accepted", "running", "running"]
    assert "asked for another route (1 of 3)" in robot.news[-1].text
    assert robot.requests[-1].base[0][0] == pytest.approx(stood, abs=1e-3)
    robot.touching = []
    robot.step(plan=Plan(id=robot.requests[-1].id, route=[(stood, 0.5, 0.0), (2.0, 0.0, 0.0)]))
    robot.run(20.0)
    assert robot.news[-1].state == "succeeded"
    assert robot.x == pytest.approx(2.0, abs=3e-3)


def test_a_stop_ends_a_route_and_what_waits_for_one(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    go_and_meet_a_post(robot)
    assert robot.go(1, "stop").state == "succeeded"
    stood = robot.x
    robot.step(plan=Plan(id=robot.requests[-1].id, route=[(2.0, 0.0, 0.0)]))
    robot.run(1.0)
    assert robot.x == pytest.approx(stood, abs=1e-3)
