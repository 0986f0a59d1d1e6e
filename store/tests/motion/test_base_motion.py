"""The base on a simulated differential drive, whose wheels lag, jam, or turn with noise."""

import itertools
import math
import random
from pathlib import Path

import numpy as np
import pytest

from stepbus_schemas import BaseState, Goal
from stepbus_store.motion.base_motion import BaseMotion
from stepbus_store.motion.mobile import Params
from stepbus_store.motion.outcome import Refused
from stepbus_store.planner.base_curve import rounded_routes
from stepbus_store.planner.params import Params as PlannerParams

PLANS = PlannerParams(model=Path(), joints=())
DT = 0.008
TRACK = 0.5


class DiffDrive:
    """Wheels that follow their commands by a time constant; odometry sees all they do.

    noise: of the speed of each wheel, as a share. jam: wheel that stands from a time on [s].
    """

    def __init__(self, noise=0.0, lag=0.02, start=(0.0, 0.0, 0.0)):
        self.motion = BaseMotion(Params(model=Path(), joints=()))
        self.x, self.y, self.yaw = start
        self.wheels = [0.0, 0.0]
        self.noise, self.lag, self.jam = noise, lag, None
        self.random = random.Random(1)
        self.t, self.speeds, self.turns, self.path = 0.0, [], [], []
        self.motion.hold(self.state())

    def state(self):
        left, right = self.wheels
        return BaseState(
            x=self.x, y=self.y, yaw=self.yaw, vx=(left + right) / 2, wz=(right - left) / TRACK
        )

    def step(self, gap=math.inf):
        """Move on by a step; returns what the controller says of the goal."""
        self.motion.advance(DT, gap)
        outcome = self.motion.check(self.state())
        command = self.motion.command()
        self.speeds.append(command.vx)
        self.turns.append(command.wz)
        for side, sign in ((0, -1), (1, 1)):
            wanted = command.vx + sign * TRACK / 2 * command.wz
            wanted *= 1 + self.random.gauss(0, self.noise)
            self.wheels[side] += (wanted - self.wheels[side]) * min(1.0, DT / self.lag)
        if self.jam is not None and self.t >= self.jam[1]:
            self.wheels[self.jam[0]] = 0.0
        now = self.state()
        self.x += now.vx * DT * math.cos(self.yaw + now.wz * DT / 2)
        self.y += now.vx * DT * math.sin(self.yaw + now.wz * DT / 2)
        self.yaw += now.wz * DT
        self.t += DT
        self.path.append((self.x, self.y, self.yaw))
        return outcome

    def go(self, seconds=30.0, **goal):
        """Return how a goal has ended; None: not in time."""
        self.motion.start(Goal(id=0, **goal), self.state())
        return self.wait(seconds)

    def wait(self, seconds=30.0, gap=lambda base: math.inf):
        """Move on; gap: distance to the nearest thing, from this stand."""
        for _ in range(round(seconds / DT)):
            outcome = self.step(gap(self))
            if outcome is not None:
                return outcome
        return None


@pytest.mark.parametrize("distance", [1.5, -1.5, 0.02])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_a_drive_ends_within_a_millimetre(distance, noise):
    base = DiffDrive(noise=noise)
    outcome = base.go(type="drive", by=distance)
    assert outcome.state == "succeeded"
    assert (base.x, base.y, base.yaw) == pytest.approx((distance, 0.0, 0.0), abs=1.2e-3)
    assert max(map(abs, base.speeds)) <= 0.5 * 1.2


@pytest.mark.parametrize("angle", [math.pi / 2, -math.pi / 2, math.pi, 4.0])
def test_a_turn_ends_within_a_tenth_of_a_degree(angle):
    base = DiffDrive(noise=0.05)
    assert base.go(type="turn", by=angle).state == "succeeded"
    assert base.yaw == pytest.approx(angle, abs=math.radians(0.11))
    assert math.hypot(base.x, base.y) < 2e-3


@pytest.mark.parametrize(
    "target", [(1.5, 0.0, 0.0), (0.0, -1.5, -math.pi / 2), (1.0, 1.0, math.pi), (0.0, 0.0, 1.0)]
)
def test_a_place_is_reached_to_millimetres(target):
    base = DiffDrive(noise=0.05, start=(0.1, -0.05, 0.2))
    assert base.go(type="go_to", base=target).state == "succeeded"
    assert (base.x, base.y) == pytest.approx(target[:2], abs=3e-3)
    assert math.remainder(base.yaw - target[2], 2 * math.pi) == pytest.approx(0.0, abs=2e-3)


def test_a_place_behind_is_backed_up_to_without_turning_round():
    base = DiffDrive(start=(1.5, 0.0, 0.0))
    assert base.go(type="go_to", base=(0.0, 0.0, 0.0)).state == "succeeded"
    assert max(abs(yaw) for _, _, yaw in base.path) < 0.02
    assert base.x == pytest.approx(0.0, abs=2e-3)


def test_a_base_that_is_pushed_aside_comes_back_to_its_line():
    base = DiffDrive()
    base.motion.start(Goal(id=0, type="drive", by=1.5), base.state())
    base.wait(seconds=1.5)
    base.y += 0.02
    assert base.wait().state == "succeeded"
    assert abs(base.y) < 2e-3


def test_a_jammed_wheel_is_named_with_numbers():
    base = DiffDrive()
    base.jam = (0, 1.5)
    outcome = base.go(type="drive", by=1.5)
    assert (outcome.state, outcome.cause) == ("failed", "jammed")
    assert "left wheel rolls at 0.00 m/s instead" in outcome.text
    assert "of 1.500 m" in outcome.text
    assert base.t < 2.5
    assert base.motion.command().vx == 0.0


@pytest.mark.parametrize("wheel", [0, 1])
@pytest.mark.parametrize("before", [0.25, 0.3, 0.5])
def test_a_wheel_that_jams_shortly_before_the_goal_is_named(before, wheel):
    base = DiffDrive()
    base.go(type="drive", by=0.8)
    end, base = base.t, DiffDrive()
    base.jam = (wheel, end - before)
    outcome = base.go(type="drive", by=0.8)
    assert (outcome.state, outcome.cause) == ("failed", "jammed")
    assert f"{('left', 'right')[wheel]} wheel rolls at 0.00 m/s instead" in outcome.text
    assert outcome.text.count("wheel") == 1


def test_the_base_stops_before_what_it_drives_towards():
    base = DiffDrive()
    base.motion.start(Goal(id=0, type="drive", by=2.0), base.state())
    base.wait(seconds=8.0, gap=lambda base: min(1.0 - base.x, 0.08))
    assert max(base.speeds) == pytest.approx(0.5, rel=0.02)
    # It creeps from its clearance on; a monitor halts it then.
    slow = next(
        x for (x, _, _), v in zip(base.path, base.speeds, strict=True) if x > 0.5 and v <= 0.03
    )
    assert 0.97 < slow < 0.995


def test_a_turn_is_slow_where_its_farthest_point_comes_near_something():
    base = DiffDrive()
    base.motion.start(Goal(id=0, type="turn", by=3.0), base.state())
    base.wait(seconds=10.0, gap=lambda base: min(0.9 * (1.5 - base.yaw), 0.08))
    assert max(base.turns) == pytest.approx(0.8, rel=0.02)
    slow = next(
        yaw for (_, _, yaw), w in zip(base.path, base.turns, strict=True) if yaw > 1 and w <= 0.034
    )
    assert 0.9 * (1.5 - slow) > 6e-3


def test_near_things_speed_grows_no_faster_than_the_acceleration_limit():
    base = DiffDrive(lag=0.001)
    base.motion.start(Goal(id=0, type="drive", by=2.5), base.state())
    base.wait(seconds=1.6, gap=lambda base: 0.0)
    assert base.speeds[-1] == pytest.approx(0.03, rel=0.1)
    base.speeds = base.speeds[-1:]
    assert base.wait().state == "succeeded"
    assert largest(changes(base.speeds)) <= 1.02 * 0.4
    assert base.x == pytest.approx(2.5, abs=1.2e-3)


def test_a_stop_brakes_as_hard_as_motors_and_ground_allow():
    base = DiffDrive()
    base.go(type="go_to", base=(1.5, 0.0, 0.0), seconds=1.5)
    here, speed = base.x, base.speeds[-1]
    base.motion.stop()
    assert base.wait().state == "succeeded"
    base.wait(seconds=1.0)
    assert base.x - here == pytest.approx(speed**2 / 2 / 4.0 + 0.5 * 0.02, rel=0.4)
    assert not base.motion.is_moving


def test_locked_wheels_stop_it_at_once_and_it_goes_back_the_way_that_it_came():
    base = DiffDrive()
    base.go(type="drive", by=-1.0, seconds=2.0)
    assert base.motion.back_off(0.05)
    base.step()
    assert base.motion.is_halting
    assert base.motion.command().vx == 0.0
    stood = min(x for x, _, _ in base.path)
    assert base.wait().state == "succeeded"
    turned_at = min(x for x, _, _ in base.path)
    assert stood - turned_at < 0.02
    assert base.x - turned_at == pytest.approx(0.05, abs=3e-3)


def test_a_base_that_has_not_begun_to_move_has_no_way_back():
    base = DiffDrive()
    assert not base.motion.back_off(0.05)
    base.wait(seconds=0.2)
    assert not base.motion.is_moving


def test_a_new_goal_begins_where_the_old_one_is_brought_to_rest():
    base = DiffDrive()
    base.go(type="drive", by=1.5, seconds=1.5)
    assert base.go(type="go_to", base=(0.0, 0.0, 0.0)).state == "succeeded"
    assert (base.x, base.y, base.yaw) == pytest.approx((0.0, 0.0, 0.0), abs=2e-3)


@pytest.mark.parametrize(
    "goal", [{"type": "drive", "by": math.nan}, {"type": "turn", "by": math.inf},
             {"type": "go_to"}, {"type": "go_to", "base": (0.0, math.nan, 0.0)}]
)  # fmt: skip
def test_a_goal_without_sense_is_refused(goal):
    with pytest.raises(Refused):
        DiffDrive().go(**goal)


def test_a_base_at_rest_goes_slowly_back_to_its_place():
    base = DiffDrive()
    assert base.go(type="drive", by=0.5).state == "succeeded"
    base.x -= 0.01
    base.wait(seconds=2.0)
    assert base.x == pytest.approx(0.5, abs=2e-4)
    assert max(map(abs, base.speeds[-240:])) <= 0.02


def test_a_base_that_is_pushed_far_away_does_not_push_back():
    base = DiffDrive()
    base.step()
    base.x += 0.2
    base.wait(seconds=1.0)
    assert base.x == pytest.approx(0.2)


def arc_route(count, length, curvature):
    """Return poses of arcs of a curvature [1/m] that changes its sign half-way."""
    x = y = yaw = 0.0
    poses = []
    for n in range(count):
        step, turn = length / count, (1 if n < count / 2 else -1) * curvature * length / count
        x, y = x + step * math.cos(yaw + turn / 2), y + step * math.sin(yaw + turn / 2)
        yaw += turn
        poses.append((x, y, yaw))
    return poses


@pytest.mark.parametrize("sign", [1, -1])
def test_arcs_are_driven_in_one_go_forwards_and_backwards(sign):
    route = arc_route(40, sign * 2.0, sign * 0.8)
    base = DiffDrive(noise=0.05)
    base.motion.start(Goal(id=0, type="go_to", base=route[-1]), base.state(), route)
    assert base.wait().state == "succeeded"
    assert (base.x, base.y, base.yaw) == pytest.approx(route[-1], abs=3e-3)
    inside = [speed for speed in base.speeds if abs(speed) > 0.1]
    assert {math.copysign(1, speed) for speed in inside} == {sign}
    # Where the curve turns the other way, it slows down: 1 s.
    assert base.t < 2.0 / 0.5 + 0.5 / 0.4 + 2.5
    for pose in route[::4]:
        assert min(math.dist(pose[:2], row[:2]) for row in base.path) < 6e-3


def changes(values):
    return [(b - a) / DT for a, b in itertools.pairwise(values)]


def largest(values):
    return max(map(abs, values))


def keeps_limits(speeds, acceleration, jerk):
    """Return whether commands keep limits to 2 %, differentiated once and twice."""
    rates = changes([0.0, *speeds])
    is_kept = largest(rates) <= 1.02 * acceleration
    return is_kept and largest(changes([0.0, *rates])) <= 1.02 * jerk


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("curvature", [0.8, -2.0])
def test_commands_keep_the_limits_of_the_base_on_any_curve(noise, curvature):
    route = arc_route(40, 2.0, curvature)
    base = DiffDrive(noise=noise)
    base.motion.start(Goal(id=0, type="go_to", base=route[-1]), base.state(), route)
    assert base.wait().state == "succeeded"
    assert keeps_limits(base.speeds, 0.4, 2.0)
    assert keeps_limits(base.turns, 0.8, 4.0)
    assert max(map(abs, base.speeds)) <= 0.5 * 1.02
    assert max(map(abs, base.turns)) <= 0.8 * 1.02


@pytest.mark.parametrize("seed", range(6))
def test_a_detour_is_driven_as_fast_as_it_bends_and_keeps_the_limits(seed):
    chance = random.Random(seed)
    corners = [(0.0, 0.0)]
    for _ in range(chance.choice([1, 2])):
        corners.append((corners[-1][0] + chance.uniform(0.3, 0.6), chance.uniform(-0.6, 0.6)))
    corners.append((1.7, chance.uniform(-0.4, 0.4)))
    found = list(rounded_routes((0, 0, 0), (*corners[-1], 0), list(map(np.array, corners)), PLANS))
    best = min(found, key=lambda route: route.seconds)
    base = DiffDrive()
    base.motion.start(Goal(id=0, type="go_to", base=best.poses[-1]), base.state(), best.poses[1:])
    assert base.wait().state == "succeeded"
    assert keeps_limits(base.speeds, 0.4, 2.0)
    assert keeps_limits(base.turns, 0.8, 4.0)
    route = np.array(best.poses)[:, :2]
    off = [np.linalg.norm(route - place[:2], axis=1).min() for place in base.path]
    # Two poses of the route are 50 mm apart.
    assert max(off) < 0.03
    # The planner's estimate leaves out the jerk.
    assert base.t < 1.15 * best.seconds


def test_a_base_goes_gently_after_what_it_has_lost():
    base = DiffDrive()
    base.motion.start(Goal(id=0, type="drive", by=2.0), base.state())
    base.wait(seconds=2.0)
    # As where a map corrects odometry, or another body gives a push.
    base.x, base.y, base.yaw = base.x - 0.03, base.y + 0.02, base.yaw + 0.03
    assert base.wait().state == "succeeded"
    assert keeps_limits(base.speeds, 0.4, 2.0)
    assert keeps_limits(base.turns, 0.8, 4.0)
    assert (base.x, base.y) == pytest.approx((2.0, 0.0), abs=3e-3)


def test_what_its_skin_measures_with_noise_is_approached_within_the_limits():
    base = DiffDrive()
    noise = random.Random(2)
    base.motion.start(Goal(id=0, type="drive", by=2.0), base.state())
    # It ends 50 mm before something, whose skin measures 5 % too little.
    outcome = base.wait(gap=lambda base: min((2.05 - base.x) * noise.gauss(0.95, 0.01), 0.08))
    assert outcome.state == "succeeded"
    assert keeps_limits(base.speeds, 0.4, 2.0)


def test_what_appears_is_braked_for_within_the_limits_of_the_brake():
    base = DiffDrive()
    base.motion.start(Goal(id=0, type="drive", by=2.0), base.state())
    base.wait(seconds=2.0)
    assert keeps_limits(base.speeds, 0.4, 2.0)
    there = base.x + 0.065
    assert base.wait(seconds=0.4, gap=lambda base: min(there - base.x, 0.08)) is None
    assert keeps_limits(base.speeds, 4.0, 4.0 / 0.04)
    assert min(changes(base.speeds)) == pytest.approx(-4.0, rel=0.02)
    assert 0.0 < there - base.x < 0.015
    # It goes on as gently as before.
    base.speeds = base.speeds[-3:]
    assert base.wait().state == "succeeded"
    assert largest(changes(base.speeds)) <= 1.02 * 0.4
    assert largest(changes(changes(base.speeds))) <= 1.02 * 2.0


@pytest.mark.parametrize("goal", [{"type": "drive", "by": -1.5}, {"type": "turn", "by": 2.0}])
@pytest.mark.parametrize("seed", range(5))
def test_what_comes_and_goes_stops_no_goal(goal, seed):
    base, gaps = DiffDrive(), random.Random(seed)
    base.motion.start(Goal(id=0, **goal), base.state())
    outcome = base.wait(gap=lambda _: 0.08 * gaps.random() if gaps.random() < 0.2 else math.inf)
    assert outcome.state == "succeeded"
    assert keeps_limits(base.speeds, 4.0, 4.0 / 0.04)
    assert keeps_limits(base.turns, 10.0, 10.0 / 0.04)


def test_ahead_in_a_turn_no_point_of_a_robot_moves_far_between_two_poses():
    motion = DiffDrive().motion
    motion.start(Goal(id=0, type="turn", by=1.5), motion.state)
    yaws = [yaw for _, (_, _, yaw) in motion.ahead()]
    assert yaws[-1] == pytest.approx(1.5)
    steps = [0.9 * (b - a) for a, b in itertools.pairwise(yaws)]
    assert max(steps) <= 0.1 + 1e-9
