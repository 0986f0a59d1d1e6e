"""A base for which something comes into the way: it stops, waits, and goes on."""

import pytest
from support.services.mobile import DT, Robot, config

from stepbus_schemas import Plan


def driven(robot, seconds=1.5):
    """Let the base drive towards x = 2 for a while."""
    robot.start(0, "go_to", base=(2.0, 0.0, 0.0))
    robot.step(plan=Plan(id=robot.requests[-1].id, route=[(2.0, 0.0, 0.0)]))
    robot.run(seconds)
    assert robot.vx > 0.3


def test_what_a_lidar_sees_ahead_stops_the_base_and_it_goes_on_once_there_is_a_way(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    driven(robot)
    asked = len(robot.requests)
    robot.step(plan=Plan(id=robot.requests[-1].id, cause="blocked", text="a cat is ahead"))
    robot.run(0.5)
    assert robot.vx == pytest.approx(0.0, abs=5e-3)
    assert robot.news[-1].text.startswith("a cat is ahead; stops")
    assert len(robot.requests) == asked + 1
    robot.step(plan=Plan(id=robot.requests[-1].id, cause="occupied", text="the cat sits there"))
    robot.run(1.0)
    assert len(robot.requests) == asked + 2
    robot.step(plan=Plan(id=robot.requests[-1].id, route=[(2.0, 0.0, 0.0)]))
    robot.run(15.0)
    assert robot.news[-1].state == "succeeded"
    assert robot.x == pytest.approx(2.0, abs=3e-3)


def test_a_base_does_not_wait_for_ever(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    driven(robot)
    robot.step(plan=Plan(id=robot.requests[-1].id, cause="blocked", text="a wall is ahead"))
    for _ in range(60):
        robot.run(0.5)
        if robot.news[-1].state == "failed":
            break
        occupied = Plan(id=robot.requests[-1].id, cause="occupied", text="the wall stands there")
        robot.step(plan=occupied)
    assert (robot.news[-1].state, robot.news[-1].cause) == ("failed", "no_path")
    assert robot.news[-1].text.endswith("in the way for 20 s")
    assert 20.0 < robot.k * DT < 26.0


def test_a_route_that_is_blocked_before_it_is_driven_is_asked_for_again(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    robot.start(0, "go_together", base=(2.0, 0.0, 0.0))
    first = robot.requests[-1].id
    robot.step(plan=Plan(id=first, route=[(2.0, 0.0, 0.0)]))
    robot.run(0.1)
    robot.step(plan=Plan(id=first, cause="blocked", text="a cat is ahead"))
    robot.run(0.8)
    assert robot.requests[-1].id > first
    assert robot.news[-1].state in ("accepted", "running")
