"""Moves an arm: to poses by a planner or straight, along lines and spirals; stops, backs off."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stepbus_kinematics import RobotModel, Vector
from stepbus_motion.goals.outcome import Outcome, Refused, Settling
from stepbus_motion.goals.settling import SettleWatch
from stepbus_motion.goals.targets import frame_in_base, target_pose
from stepbus_motion.ik.analytic import BranchSettings, BranchSolver
from stepbus_motion.paths.motion import JointMotion, Motion, MotionLimits, motion_to, stop_from
from stepbus_motion.paths.spiral import SpiralMaker, SpiralSettings
from stepbus_motion.paths.tip_path import follow, line
from stepbus_motion.paths.trajectories import (
    AlongPath,
    Joined,
    JointPath,
    Rest,
    Trajectory,
    fitted,
    joint_path,
    planned,
    scaled,
)
from stepbus_schemas import BaseState, Goal, Plan, PlanRequest, RunError

from .back_off import WayBack
from .braking import hard_stop
from .candidates import Leg, LegFinder
from .clock import MotionClock

_AT_ONCE = 1e-6
"""So near is a target that no motion is needed [rad]."""

_HOPELESS = {"bad_request": "invalid", "not_holdable": "not_holdable"}
"""Cause of a planner → of the goal, where no other way would do; otherwise there is no way."""


@dataclass(frozen=True, kw_only=True)
class ManipulatorOptions:
    """How an arm moves.

    period: between two commands [s]. tip: whose way counts in `back_off`. uses_planner: whether
    joint motions are asked for at a planner. tip_velocity, tip_acceleration, tip_jerk: of lines
    and spirals [m/s, m/s², m/s³]. tip_turning: fastest turn of the tip [rad/s]. plan_timeout: so
    long a planner may take [s of simulation]. most_branches: ways to stand that are tried.
    singular_below: smallest singular value of the tip's Jacobian that is put up with. effort_share:
    of the effort limits that motions may need. raise_by, most_raises: of the points of a spiral
    that are out of reach [m]. back_off_share: of the largest velocity, on the way back.
    brake_acceleration, brake_jerk: of `stop` and `back_off`, where the motors are strong enough
    [rad/s², rad/s³].
    """

    period: float
    tip: str
    uses_planner: bool = False
    tip_velocity: float = 0.25
    tip_acceleration: float = 0.5
    tip_jerk: float = 5.0
    tip_turning: float = 1.0
    plan_timeout: float = 5.0
    most_branches: int = 4
    singular_below: float = 0.01
    effort_share: float = 0.9
    raise_by: float = 0.05
    most_raises: int = 10
    back_off_share: float = 0.3
    brake_acceleration: float = 12.0
    brake_jerk: float = 400.0

    @property
    def turn_radius(self) -> float:
        """Return how long a turn of 1 rad counts on a way of the tip [m]."""
        return self.tip_velocity / self.tip_turning


@dataclass(kw_only=True)
class _Search:
    """Legs that a planner is asked for, one after the other.

    rest: where the arm waits, shape (n,) [rad]. asked_at: when, for the newest [s].
    """

    goal: Goal
    held: str
    rest: Vector
    legs: Iterator[Leg]
    leg: Leg
    asked_at: float
    request: PlanRequest
    refusals: list[str]


class Manipulator:
    """Carries out the goals of an arm, one at a time; it knows nothing of the bus.

    In every step, in this order: `advance` the clock, `look` at what was measured, `take_plan`,
    `begin`, publish `request()`, command `at(t)`. limits: of the joints. seed: of the search for
    poses that have no analytic solution. Vectors are of shape (n,) [rad, rad/s, rad/s²].
    """

    def __init__(
        self,
        robot: RobotModel,
        limits: MotionLimits,
        settling: Settling,
        options: ManipulatorOptions,
        *,
        seed: int,
    ) -> None:
        self._robot = robot
        self._limits = limits
        self._settling = settling
        self._options = options
        branches = BranchSettings(
            singular_below=options.singular_below, effort_share=options.effort_share
        )
        self._solver = BranchSolver(robot, branches, seed=seed)
        spirals = SpiralSettings(
            raise_by=options.raise_by,
            most_raises=options.most_raises,
            singular_below=options.singular_below,
            turn_radius=options.turn_radius,
        )
        maker = SpiralMaker(robot, self._solver, spirals)
        self._legs = LegFinder(robot, self._solver, maker)
        self._clock = MotionClock(limits.acceleration)
        self._t = 0.0
        self._trajectory: Trajectory | None = None
        self._obeys_scale = True
        self._goes_back = False
        self._search: _Search | None = None
        self._settle: SettleWatch | None = None
        self._tip = options.tip
        self._verdict: Outcome | None = None
        self._request: PlanRequest | None = None
        self._next_request = 0
        self._route: _Search | None = None
        self._route_ends = 0.0
        self._blocked = ""
        self._behind = WayBack(robot, options.tip)

    @property
    def is_busy(self) -> bool:
        """Return whether something is under way that `look` will tell the end of."""
        return not (self._search is None and self._settle is None and self._verdict is None)

    @property
    def is_moving(self) -> bool:
        """Return whether the commanded joints have not come to rest yet."""
        return self._trajectory is not None and self._clock.s < self._trajectory.duration

    @property
    def follows_plan(self) -> bool:
        """Return whether the arm is on a planner's way, which `replan` can replace."""
        return self._route is not None and self._search is None and self._clock.s < self._route_ends

    @property
    def blocked(self) -> str:
        """Return what the planner says has come into the way that is being gone; or nothing."""
        return self._blocked if self.follows_plan else ""

    def hold(self, q: Vector) -> None:
        """Stand still at q: where the joints are when it all begins."""
        self._route = None
        self._forget()
        self._start(Rest(np.clip(q, self._robot.lower, self._robot.upper)))

    def advance(self, dt: float, scale: float) -> None:
        """Move the motion on by dt [s] of simulation; its time runs `scale` times as fast.

        scale: 0 (stand) to 1. It is approached so that the joints keep their acceleration limits.
        """
        trajectory = self._needed()
        wanted = min(max(scale, 0.0), 1.0) if self._obeys_scale else 1.0
        self._clock.advance(dt, wanted, trajectory)
        self._t += dt
        if not self._goes_back:
            self._behind.remember(trajectory.at(self._clock.s).position)

    def at(self, t: float) -> JointMotion:
        """Return what to command at a time [s].

        Its velocity takes the position to the one of the next period, as position motors want it.
        """
        now, period = self._at(t), self._options.period
        then = self._at(t + period)
        lower, upper = self._robot.lower, self._robot.upper
        position = np.clip(now.position, lower, upper)
        velocity = (np.clip(then.position, lower, upper) - position) / period
        return JointMotion(position=position, velocity=velocity, acceleration=now.acceleration)

    def begin(self, goal: Goal, q: Vector, base: BaseState, t: float, *, held: str = "") -> str:
        """Take in a goal and return a sentence for its status; the one before is forgotten.

        q: measured. base: odometry. held: link of the world in the gripper. Raises Refused for
        a goal that cannot be carried out; then the arm comes to rest.
        """
        now = self._catch_up(t)
        self._route = None
        self._forget()
        self._tip = goal.tip or self._options.tip
        try:
            if not (math.isfinite(goal.duration) and goal.duration >= 0):
                text = f"duration {goal.duration:g} s is no length of time"
                raise Refused("invalid", text)
            return self._begin(goal, now, q, base, held)
        except RunError as exc:
            self._brake(now)
            if isinstance(exc, Refused):
                raise
            raise Refused("invalid", str(exc)) from exc

    def request(self) -> PlanRequest | None:
        """Return what to ask the planner for, once."""
        request, self._request = self._request, None
        return request

    def take_plan(self, plan: Plan, t: float) -> None:
        """Take in a planner's answer, or that its way is blocked now; older ones are ignored."""
        search = self._search
        if search is None and self._route is not None and plan.id == self._route.request.id:
            self._blocked = plan.text if plan.cause else ""
        if search is None or plan.id != search.request.id:
            return
        if plan.cause:
            search.refusals.append(plan.text or plan.cause)
            self._ask_next(search, t, _HOPELESS.get(plan.cause, "no_way"))
            return
        try:
            motion = planned(plan, search.rest, search.leg.target, self._robot)
            parts = self._fitted([motion, *self._along(search.leg)], search.goal.duration)
        except Refused as exc:
            search.refusals.append(str(exc))
            self._ask_next(search, t, exc.cause)
            return
        self._search, self._route = None, search
        self._go_on(parts)
        after = sum(part.duration for part in parts[1:])
        self._route_ends = self._needed().duration - after

    def replan(self, t: float) -> None:
        """Come to rest as fast as the motors can, and ask for another way to the same goal.

        `take_plan` goes on from there. Needs a planner's way, be it the one that `back_off` left.
        """
        route = self._route
        if route is None:
            raise RunError("there is no planned way to replace")
        now = self._catch_up(t)
        self._forget()
        rest = self._brake(now, hard=True)
        legs = itertools.chain([route.leg], route.legs)
        self._begin_search(route.goal, route.held, rest, legs)

    def stop(self, t: float) -> None:
        """Come to rest as fast as the motors can, whatever the scale; `look` tells when."""
        now = self._catch_up(t)
        self._route = None
        self._forget()
        self._brake(now, hard=True)
        self._settle = self._watch()

    def back_off(self, t: float, distance: float) -> float:
        """Go back the way the arm came, whatever the scale; return how long that way is [m].

        distance: of the tip, wanted [m]; the remembered way may be shorter. Raises Refused where
        there is none.
        """
        now = self._catch_up(t)
        self._forget()
        rest = self._brake(now, hard=True)
        points, length = self._behind.take(rest, distance)
        path = joint_path(points)
        share = self._options.back_off_share
        slow = MotionLimits(
            velocity=np.array([share * float(self._limits.velocity.min())]),
            acceleration=np.array([float(self._limits.acceleration.min())]),
            jerk=np.array([float(self._limits.jerk.min())]),
        )
        back = fitted(AlongPath(path, slow), self._robot, self._limits)
        self._go_on([back])
        # Slow by itself, and it leads away from what has been touched.
        self._obeys_scale, self._goes_back = False, True
        return length

    def look(self, q: Vector, v: Vector, t: float) -> Outcome | None:
        """Take in what was measured; return how the goal ended, once it has."""
        if self._search is not None and t - self._search.asked_at > self._options.plan_timeout:
            text = f"the planner has not answered for {self._options.plan_timeout:g} s"
            self._fail("no_plan", f"{text}; is it running?")
        if self._verdict is not None:
            verdict, self._verdict = self._verdict, None
            return verdict
        if self._settle is None or self.is_moving:
            return None
        trajectory = self._needed()
        outcome = self._settle.look(trajectory.at(trajectory.duration).position, q, v, t)
        if outcome is not None:
            self._settle = None
            if outcome.state == "failed":
                # What cannot be reached is given up: the next motion begins where the joints are.
                self.hold(q)
        return outcome

    # Goals to motions

    def _begin(self, goal: Goal, now: JointMotion, q: Vector, base: BaseState, held: str) -> str:
        if goal.type == "stop":
            self._brake(now)
            self._settle = self._watch()
            return "stop"
        if goal.type == "move_linear":
            return self._begin_line(goal, self._brake(now), q, base)
        rest = now.position
        if self._options.uses_planner:
            rest = self._brake(now)
        legs = itertools.islice(self._legs.legs(goal, rest, q, base), self._options.most_branches)
        if self._options.uses_planner:
            return self._begin_search(goal, held, rest, legs)
        return self._begin_direct(goal, now, legs)

    def _begin_line(self, goal: Goal, rest: Vector, q: Vector, base: BaseState) -> str:
        options, robot = self._options, self._robot
        self._solver.chain(goal.tip)
        target = frame_in_base(robot, q, base, goal.frame) * target_pose(goal)
        start = robot.frame_pose(rest, goal.tip)
        if not start.isApprox(target):
            # An end that cannot be reached at all is refused with the numbers of how far it is,
            # before a way of very many poses is laid out to it.
            self._solver.solve(goal.tip, target, rest)
        way = line(start, target, options.turn_radius)
        if not way:
            self._go_on([Rest(rest)])
            return "the tip is there already"
        path = follow(robot, goal.tip, way, rest, options.singular_below)
        parts = self._fitted([self._timed(path)], goal.duration)
        self._go_on(parts)
        length = float(np.linalg.norm(target.translation - way[0].pose.translation))
        return f"straight way of {length:.3f} m; {parts[0].duration:.2f} s of motion"

    def _begin_search(self, goal: Goal, held: str, rest: Vector, legs: Iterator[Leg]) -> str:
        leg = next(legs)
        search = _Search(
            goal=goal,
            held=held,
            rest=rest,
            legs=legs,
            leg=leg,
            asked_at=self._t,
            request=self._make_request(goal, held, rest, leg.target),
            refusals=[],
        )
        if self._is_there(rest, leg):
            parts = self._fitted([Rest(rest), *self._along(leg)], goal.duration)
            self._go_on(parts)
            return leg.text or "the joints are there already"
        self._search, self._request = search, search.request
        return f"{leg.text}; asked the planner" if leg.text else "asked the planner"

    def _begin_direct(self, goal: Goal, now: JointMotion, legs: Iterator[Leg]) -> str:
        problem: Refused | None = None
        for leg in legs:
            try:
                duration = self._go_directly(goal, now, leg)
            except Refused as exc:
                problem = problem or exc
                continue
            text = f"{leg.text}; " if leg.text else ""
            return f"{text}{duration:.2f} s of motion"
        raise problem or Refused("no_way", "there is no way to stand")

    def _go_directly(self, goal: Goal, now: JointMotion, leg: Leg) -> float:
        """Begin to go to a leg's joints without a planner; return how long it takes [s]."""
        least = 0.0 if leg.paths else goal.duration
        first: Trajectory = motion_to(now, leg.target, self._limits, least)
        parts = self._fitted([first, *self._along(leg)], goal.duration)
        if now.velocity.any() and parts[0] is not first:
            # It cannot be slowed down from the start: then it begins at rest.
            first = motion_to(JointMotion.at_rest(self._brake(now)), leg.target, self._limits)
            parts = self._fitted([first, *self._along(leg)], goal.duration)
            self._go_on(parts)
        else:
            self._start(Joined(parts))
            self._settle = self._watch()
        return self._needed().duration

    def _along(self, leg: Leg) -> list[Trajectory]:
        return [self._timed(path) for path in leg.paths]

    def _timed(self, path: JointPath) -> Trajectory:
        options = self._options
        limits = MotionLimits(
            velocity=np.array([options.tip_velocity]),
            acceleration=np.array([options.tip_acceleration]),
            jerk=np.array([options.tip_jerk]),
        )
        return AlongPath(path, limits)

    def _fitted(self, parts: list[Trajectory], duration: float) -> list[Trajectory]:
        """Return the motions within the limits, together no shorter than a duration [s]."""
        share = self._options.effort_share
        within = [fitted(part, self._robot, self._limits, effort_share=share) for part in parts]
        whole = sum(part.duration for part in within)
        if not 0 < whole < duration:
            return within
        return [
            fitted(
                part,
                self._robot,
                self._limits,
                effort_share=share,
                least_duration=part.duration * duration / whole,
            )
            for part in within
        ]

    # Asking the planner

    def _make_request(self, goal: Goal, held: str, start: Vector, target: Vector) -> PlanRequest:
        number = self._next_request
        self._next_request += 1
        return PlanRequest(
            id=number,
            start=start.tolist(),
            goal=target.tolist(),
            held=held,
            touches=list(goal.touches),
        )

    def _ask_next(self, search: _Search, t: float, cause: str) -> None:
        """Ask for the next way to stand; the goal has failed where there is none."""
        leg = next(search.legs, None)
        if leg is None:
            count = len(search.refusals)
            tried = f"{count} ways to stand were tried; the last: " if count > 1 else ""
            self._fail(cause, f"{tried}{search.refusals[-1]}")
            return
        search.leg, search.asked_at = leg, t
        search.request = self._make_request(search.goal, search.held, search.rest, leg.target)
        self._request = search.request

    def _is_there(self, rest: Vector, leg: Leg) -> bool:
        return bool(np.abs(leg.target - rest).max() < _AT_ONCE)

    def _fail(self, cause: str, text: str) -> None:
        self._search, self._request = None, None
        self._verdict = Outcome(state="failed", cause=cause, text=text)

    # The motion under way

    def _needed(self) -> Trajectory:
        if self._trajectory is None:
            raise RunError("the joints have not been measured yet")
        return self._trajectory

    def _at(self, t: float) -> JointMotion:
        clock = self._clock
        now = self._needed().at(clock.s + clock.rate * (t - self._t))
        return scaled(now, clock.rate)

    def _catch_up(self, t: float) -> JointMotion:
        """Return the joints at a time [s]; what begins now begins there."""
        now = self._at(t)
        self._clock.s += self._clock.rate * (t - self._t)
        self._t = t
        return now

    def _forget(self) -> None:
        self._search, self._settle, self._verdict, self._request = None, None, None, None
        self._blocked, self._route_ends = "", 0.0

    def _start(self, trajectory: Trajectory) -> None:
        """Begin a motion now; where the joints stand, the clock keeps its rate."""
        self._goes_back = False
        moving = bool(trajectory.at(0.0).velocity.any())
        self._trajectory = trajectory
        self._clock.restart(1.0 if moving else self._clock.rate)
        self._obeys_scale = True

    def _brake(self, now: JointMotion, *, hard: bool = False) -> Vector:
        """Begin to come to rest; return where that will be."""
        if now.velocity.any() or now.acceleration.any():
            motion = self._hardest_stop(now) if hard else stop_from(now, self._limits)
            self._start(motion)
            self._clock.restart(1.0)
            self._obeys_scale = False
            return motion.at(motion.duration).position
        self._start(Rest(now.position))
        return now.position

    def _hardest_stop(self, now: JointMotion) -> Motion:
        options = self._options
        acceleration, jerk = options.brake_acceleration, options.brake_jerk
        return hard_stop(now, self._robot, self._limits, acceleration, jerk)

    def _go_on(self, parts: list[Trajectory]) -> None:
        """Begin motions, after the arm has come to rest."""
        braking = self._needed()
        if self._clock.s < braking.duration:
            s, rate = self._clock.s, self._clock.rate
            self._trajectory = Joined([braking, *parts])
            self._clock.s, self._clock.rate = s, rate
            self._obeys_scale = True
        else:
            self._start(Joined(parts))
        self._settle = self._watch()

    def _watch(self) -> SettleWatch:
        return SettleWatch(self._robot, self._settling, self._tip)
