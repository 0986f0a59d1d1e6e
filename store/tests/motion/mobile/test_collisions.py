"""What a mobile manipulator does about collisions, and about what comes close."""

import numpy as np
import pytest
from support.services.mobile import DT, Robot, config


def without_eaik(warnings):
    """Return warnings without that of an installation without eaik."""
    return [text for text in warnings if "eaik" not in text]


@pytest.mark.parametrize("goal_type", ["drive", "turn", "go_to"])
def test_the_base_does_not_move_while_the_hand_is_too_high(tmp_path, goal_type):
    robot = Robot(config(tmp_path, safe_height=0.6), q=(0.0, -1.5, 1.0, 0.0, 0.0, 0.0))
    end = robot.go(0, goal_type, by=0.5, base=(1.0, 0.0, 0.0))
    assert (end.state, end.cause) == ("failed", "too_high")
    assert "floor; the base moves only below 0.6 m" in end.text
    assert (robot.x, robot.yaw) == (0.0, 0.0)


def test_the_base_does_not_move_while_the_hand_reaches_too_far_out(tmp_path):
    robot = Robot(config(tmp_path, safe_reach=0.5), q=(0.0, 0.0, 0.2, 0.0, 0.0, 0.0))
    assert robot.go(0, "drive", by=0.5).cause == "too_far"


def test_a_jammed_base_fails_and_stands(robot):
    robot.jammed = True
    end = robot.go(0, "drive", by=1.0)
    assert end.cause == "jammed"
    assert "left wheel rolls at 0.00 m/s instead" in end.text
    assert robot.step()["base"].vx == 0.0


def test_the_arm_stops_backs_off_and_fails_when_it_touches_what_it_must_not(robot):
    robot.start(0, "move_joints", joints=["pan"], values=[2.0])
    robot.run(0.5)
    robot.touching = [("hand", "pillar", 0.0, 0.005)]
    robot.run(0.8)
    touched = robot.place("grasp").translation.copy()
    robot.touching = [("hand", "pillar", 7.5, -0.001)]
    robot.step()
    robot.touching = []
    robot.run(3.0)
    end = robot.news[-1]
    assert (end.state, end.cause) == ("failed", "collision")
    assert "7.5 N; stopped, backed off 50 mm" in end.text
    assert robot.q[0] < 2.0
    assert np.abs(robot.v).max() < 1e-9
    assert np.linalg.norm(robot.place("grasp").translation - touched) < 0.12


def test_the_base_backs_off_five_centimetres(robot):
    robot.start(0, "drive", by=1.0)
    robot.run(1.5)
    robot.touching = [("chassis", "crate", 30.0, 0.0)]
    robot.step()
    robot.touching = []
    furthest = max(self_x for self_x in _xs(robot, 4.0))
    assert robot.news[-1].cause == "collision"
    assert furthest - robot.x == pytest.approx(0.05, abs=5e-3)
    went = f"chassis touches crate with 30.0 N; stopped, backed off {1e3 * (furthest - robot.x):.0f} mm"
    assert robot.news[-1].text == f"{went} by odometry, nothing is near it"


def test_a_base_that_cannot_get_away_says_so(robot):
    robot.start(0, "drive", by=1.0)
    robot.run(1.5)
    robot.touching = [("chassis", "crate", 30.0, 0.0)]
    robot.step()
    robot.touching = [("chassis", "crate", 45.0, 0.0)]
    robot.jammed = True
    robot.run(8.0)
    text = "chassis touches crate with 30.0 N; stopped, backed off 0 mm by odometry"
    assert robot.news[-1].text == f"{text}, still touches it with 45.0 N"
    assert robot.commands[-1]["base"].vx == 0.0


def test_backing_off_stops_before_what_comes_close_behind(robot):
    robot.start(0, "drive", by=1.0)
    robot.run(1.5)
    robot.touching = [("chassis", "crate", 30.0, 0.0)]
    robot.step()
    stood = robot.x
    for _ in range(500):
        behind = 0.01 - max(stood - robot.x, 0.0)
        robot.touching = [("chassis", "crate", 0.0, 0.01), ("chassis", "post", 0.0, behind)]
        robot.step()
    assert 3e-3 < behind < 5e-3
    assert "mm from post behind it, now 10.0 mm" in robot.news[-1].text


def test_the_base_stops_before_it_touches_what_it_comes_close_to(robot):
    robot.start(0, "drive", by=2.0)
    robot.run(1.0)
    post = robot.x + 0.4
    while robot.news[-1].state not in ("failed", "succeeded"):
        if post - robot.x < 0.08:
            robot.touching = [("chassis", "post", 0.0, post - robot.x)]
        robot.step()
    assert (robot.news[-1].state, robot.news[-1].cause) == ("failed", "blocked")
    gap = 1e3 * (post - robot.x)
    assert 3.0 < gap < 5.0
    assert robot.news[-1].text == f"chassis is {gap:.1f} mm from post; stopped before it touches"
    assert robot.step()["base"].vx == 0.0


def test_what_is_close_but_comes_no_closer_does_not_stop_the_base(robot):
    robot.touching = [("chassis", "post", 0.0, 0.004)]
    assert robot.go(0, "drive", by=0.1).state == "succeeded"


def _xs(robot, seconds):
    for _ in range(round(seconds / DT)):
        robot.step()
        yield robot.x


def test_after_a_collision_the_next_goal_may_leave_what_is_still_touched(robot):
    robot.start(0, "move_joints", joints=["pan"], values=[1.0])
    robot.run(0.8)
    robot.touching = [("hand", "pillar", 7.5, -0.001)]
    robot.run(3.0)
    assert robot.news[-1].cause == "collision"
    assert robot.go(1, "move_joints", joints=["pan"], values=[0.0]).state == "succeeded"


def test_motion_is_slower_near_an_obstacle_and_says_so(tmp_path):
    times = []
    for touching in ([], [("hand", "pillar", 0.0, 0.006)]):
        robot = Robot(config(tmp_path))
        robot.step()
        robot.touching = touching
        robot.go(0, "move_joints", joints=["pan"], values=[1.0])
        times.append(robot.k * DT)
    assert times[1] > 1.8 * times[0]
    assert without_eaik(robot.warnings) == ["hand is 6 mm from pillar: slower"]


def test_an_arm_is_not_slowed_down_by_what_stands_near_the_base(robot):
    robot.touching = [("chassis", "pillar", 0.0, 0.02)]
    robot.go(0, "move_joints", joints=["pan"], values=[1.0])
    assert without_eaik(robot.warnings) == []


def test_what_slips_out_during_a_goal_fails_it(robot):
    robot.thing = 0.066
    robot.go(0, "grip", width=0.0, force=15.0)
    robot.start(1, "move_joints", joints=["pan"], values=[2.0])
    robot.run(0.4)
    robot.thing = None
    robot.run(2.0)
    end = robot.news[-1]
    assert (end.id, end.state, end.cause) == (1, "failed", "slipped")
    assert np.abs(robot.v).max() < 1e-9
