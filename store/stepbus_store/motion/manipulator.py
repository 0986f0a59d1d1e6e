"""Moves an arm: to joints and poses, along lines and spirals; stops it and backs it off."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from stepbus_kinematics import RobotModel, SelfCollisions, Vector
from stepbus_schemas import Goal, Plan, Point, RunError
from stepbus_store.cause import Cause
from stepbus_store.motion.branches import BranchSolver
from stepbus_store.motion.candidates import CandidateFinder, about_as_near
from stepbus_store.motion.fitting import all_fitted, fitted
from stepbus_store.motion.follow import Candidate, joint_path
from stepbus_store.motion.joint_motion import JointMotion, ManipulatorOptions, MotionLimits
from stepbus_store.motion.joint_params import JointParams
from stepbus_store.motion.links import Links
from stepbus_store.motion.outcome import Measured, Outcome, Refused
from stepbus_store.motion.planner_search import PlannerQueries, PlannerSearch, refusal_of
from stepbus_store.motion.player import MotionPlayer, planned
from stepbus_store.motion.routes import DetourRouter
from stepbus_store.motion.settling import JamWatch, SettleWatch
from stepbus_store.motion.trajectory import AtRest, Trajectory, along_path

_MOST_CANDIDATES = 4
"""Solutions that are tried."""

_BACK_OFF_SHARE = 0.3
"""Share of the largest velocity at which the arm backs off."""


class Manipulator:
    """Carries out the goals of an arm, one at a time; it knows nothing of the bus.

    In every step, in this order: `advance` the clock where motions may be slowed down, `check` what
    was measured, `take_plan`, `start`, publish `queries.pop()`, command `at(t)`.

    limits: of the joints. seed: of all that is random. uses_planner: `queries` ask it for motions;
    else the arm finds them, and avoids only itself. collisions: of the robot with itself; None: not
    checked. tries_unholdable: it also goes to poses that the motors cannot hold. Vectors are of
    shape (n,) [rad, rad/s, rad/s²].
    """

    def __init__(
        self,
        robot: RobotModel,
        limits: MotionLimits,
        settling: JointParams,
        options: ManipulatorOptions,
        *,
        seed: int,
        uses_planner: bool = False,
        collisions: SelfCollisions | None = None,
        tries_unholdable: bool = False,
    ) -> None:
        self._robot = robot
        share = options.effort_share
        solver = BranchSolver(robot, seed=seed, effort_share=share, collisions=collisions)
        self._finder = CandidateFinder(solver, options, tries_unholdable=tries_unholdable)
        self._router: DetourRouter | None = None
        if not uses_planner:
            self._router = DetourRouter(
                robot, limits, seed=seed, collisions=collisions, effort_share=share
            )
        self.tip = options.tip
        """Frame whose path counts when the arm backs off."""
        self.links = Links(robot, options.tip)
        self._limits = limits
        self._settling = settling
        self._options = options
        self._player = MotionPlayer(robot, limits, options, collisions)
        self.queries = PlannerQueries(options.plan_timeout)
        self._jam = JamWatch(robot, options.jam_lag, options.period)
        self._settle: SettleWatch | None = None
        self._tip = options.tip
        self._verdict: Outcome | None = None
        self._route: PlannerSearch | None = None
        self._route_ends = 0.0
        self._blocked = ""
        self._backs_off = False
        self._keeps_held = False
        self._ready: tuple[list[Trajectory], PlannerSearch] | None = None
        self._bases: Sequence[Point] = ()
        self._began_at = self._ended_at = 0.0
        self.took: float | None = None
        """How long the last motion took, once it is over [s]."""
        self.caution = ""
        """Cause for which the motion under way will probably fail; empty: none."""

    @property
    def follows_plan(self) -> bool:
        """Return whether the arm is on a planner's path, which `replan` can replace."""
        is_known = self._route is not None and self.queries.search is None
        return is_known and self._player.clock.s < self._route_ends

    @property
    def blocked(self) -> str:
        """Return the planner's report of an obstacle on the path under way; empty: none."""
        is_under_way = self.queries.search is None and self._player.late(self._player.clock.t) < 0
        return self._blocked if self._route is not None and is_under_way else ""

    def carry(self, load: float) -> None:
        """Move with a mass at the tip from the next goal on [kg]."""
        if load != self.queries.load:
            self.queries.load = load
            self._robot.carry(load, self.tip)

    def hold(self, q: Vector) -> None:
        """Stand still at q."""
        self._route = None
        self._forget()
        self._player.rest(q)

    def advance(self, dt: float, scale: float) -> None:
        """Move on by dt [s]; time comes to run `scale`, 0 to 1, as fast, without a jerk."""
        q = self._player.advance(dt, scale)
        if not self._backs_off:
            self.links.record(q)

    def at(self, t: float) -> JointMotion:
        """Return the command for a time [s]."""
        command = self._player.command(t)
        self._jam.command(command)
        return command

    @property
    def is_moving(self) -> bool:
        """Return whether the motion under way moves the joints now."""
        return bool(self._player.nominal().velocity.any())

    def link_speeds(self) -> Callable[[str], tuple[float, float]]:
        """Return a function: link → its speed now, and at the full rate of the motion [m/s]."""
        return self.links.speeds(self._player.nominal(), self._player.clock.rate)

    def start(
        self, goal: Goal, at: Measured, t: float, *, held: str = "", bases: Sequence[Point] = ()
    ) -> str:
        """Start a goal and return a sentence for its status; the one before is forgotten.

        at: joints and base. held: link of the world in the gripper. bases: poses of a base that
        drives at which the path has to be free; then the arm waits for `release`. Raises Refused
        for a goal that cannot be carried out; then the arm comes to rest.
        """
        now = self._give_up(t)
        self._bases = bases
        self._tip = (goal.tip or self.tip) if self.tip else ""
        try:
            if not (math.isfinite(goal.duration) and goal.duration >= 0):
                text = f"duration is {goal.duration:g} s; it must be finite and not negative"
                raise Refused(Cause.INVALID, text)
            return self._begin(goal, self._brake(now), at, held)
        except RunError as exc:
            self._brake(now)
            if isinstance(exc, Refused):
                raise
            raise Refused(Cause.INVALID, str(exc)) from exc

    @property
    def is_ready(self) -> bool:
        """Return whether a path waits for `release`, or none is needed."""
        return self._ready is not None or (self._settle is not None and self.queries.search is None)

    def release(self) -> None:
        """Move along the path that is known, or as soon as it is."""
        self._bases = ()
        ready, self._ready = self._ready, None
        if ready is not None:
            self._follow(*ready)

    def take_plan(self, plan: Plan, t: float) -> None:
        """Follow a planner's answer, or record that its path is blocked; older ones are ignored."""
        search = self.queries.search
        if search is None:
            self._block(plan)
        if search is None or plan.id != search.request_id:
            return
        try:
            if plan.cause:
                raise refusal_of(plan)
            target, is_there = search.candidate.target, search.candidate.is_at(search.rest)
            first = [] if is_there else [planned(plan, search.rest, target, self._robot)]
            parts = self._fitted(search.candidate, search.goal.duration, first)
        except Refused as exc:
            self._fail(self.queries.try_next(search, exc, t))
            return
        self.queries.cancel()
        search.candidates = iter([])
        if self._bases:
            self._ready = (parts, search)
        else:
            self._follow(parts, search)

    def _block(self, plan: Plan) -> None:
        """Record that the path under way is blocked, or forget the one that waits."""
        if self._route is not None and plan.id == self._route.request_id:
            self._blocked = plan.text if plan.cause else ""
        elif self._ready is not None and plan.id == self._ready[1].request_id and plan.cause:
            self._ready = None
            self._fail(Refused(Cause.BLOCKED, plan.text))

    def _follow(self, parts: list[Trajectory], search: PlannerSearch) -> None:
        self._route = search
        self._then(parts)
        # What follows the plan is a given path, such as a line: no other one can replace it.
        after = sum(part.duration for part in parts[len(parts) - len(search.candidate.paths) :])
        self._route_ends = self._player.trajectory.duration - after

    def _fitted(
        self, candidate: Candidate, duration: float = 0.0, first: Sequence[Trajectory] = ()
    ) -> list[Trajectory]:
        """Return the motions along a candidate's paths, after others; duration: of all [s]."""
        along = (along_path(path, self._options.tip_limits) for path in candidate.paths)
        return all_fitted(
            [*first, *along],
            self._robot,
            self._limits,
            effort_share=self._options.effort_share,
            least_duration=duration,
        )

    def replan(self, t: float, *, touches: bool = False) -> None:
        """Come to rest as fast as the motors can, and ask for another path to the same goal.

        What the gripper holds is kept, unless the robot touches something, or is about to.
        `take_plan` continues from there. Raises RunError without a planner's path, under way or
        left by `back_off` or `stop`.
        """
        route = self._route
        if route is None:
            raise RunError("there is no planned path to replace")
        rest = self._brake(self._give_up(t, keeps_route=True), hard=True, touches=touches)
        candidates = itertools.chain([route.candidate], route.candidates)
        self._search(route.goal, route.held, rest, candidates)

    def stop(self, t: float, *, touches: bool = False, keeps_route: bool = False) -> None:
        """Come to rest as fast as the motors can, whatever the scale; `check` reports when.

        What the gripper holds is kept, unless the robot touches something, or is about to.
        keeps_route: `replan` will continue.
        """
        self._brake(self._give_up(t, keeps_route=keeps_route), hard=True, touches=touches)
        self._watch()

    def stop_harder(self, t: float) -> None:
        """Stop as hard as the motors can, where a stop is under way that keeps what is held."""
        if not (self._keeps_held and self.is_moving):
            return
        if self._route is not None and self.queries.search is not None:
            self.replan(t, touches=True)
        else:
            self.stop(t, touches=True, keeps_route=True)

    def back_off(self, t: float, distance: float) -> float:
        """Go back along the path the arm came, whatever the scale; return its length [m].

        distance: of the tip, wanted [m]; the recorded path may be shorter. Raises Refused where
        there is none.
        """
        rest = self._brake(self._give_up(t, keeps_route=True), hard=True, touches=True)
        points, length = self.links.take(rest, distance)
        slow = MotionLimits.of_one(
            _BACK_OFF_SHARE * float(self._limits.velocity.min()),
            float(self._limits.acceleration.min()),
            float(self._limits.jerk.min()),
        )
        self._then([fitted(along_path(joint_path(points), slow), self._robot, self._limits)])
        # Slow by itself, and it leads away from what the robot has touched.
        self._player.ignores_scale = self._backs_off = True
        return length

    def jam(self, q: Vector, effort: Vector | None, t: float) -> str:
        """Come to rest where a joint does not follow; return a sentence on it, else nothing.

        q, effort: measured [rad, N·m]; None: it is not sensed. That joint stays where it is.
        """
        stuck = self._jam.stuck(q)
        if not stuck.any():
            return ""
        self._brake(self._give_up(t).without(stuck, q), hard=True, touches=True)
        self._watch()
        return self._jam.text(effort)

    def check(self, q: Vector, v: Vector, t: float) -> Outcome | None:
        """Compare with what was measured; return how the goal ended, once it has."""
        self._fail(self.queries.overdue(t))
        if self._verdict is not None:
            verdict, self._verdict = self._verdict, None
            return verdict
        late = self._player.late(t)
        if self._settle is None or late < 0:
            return None
        if self.took is None:
            self._ended_at = t - late
            self.took = self._ended_at - self._began_at
        outcome = self._settle.check(q, v, t - self._ended_at)
        if outcome is not None:
            self._settle = None
            if outcome.state == "failed":
                # What is out of reach is given up: the next motion starts where the joints are.
                self.hold(q)
        return outcome

    # From a goal to a motion

    def _begin(self, goal: Goal, rest: Vector, at: Measured, held: str) -> str:
        if goal.type == "move_linear":
            return self._line(goal, rest, at, held)
        solutions = self._finder.candidates(goal, rest, at)
        if self._bases:
            # Later, while the base stands, the arm may go the short way.
            solutions = about_as_near(solutions, rest)
        candidates: Iterator[Candidate] = itertools.islice(solutions, _MOST_CANDIDATES)
        if goal.type != "spiral":
            # All at once, so that they can be saved; those of a spiral take too long for that.
            candidates = iter(list(candidates))
        if self._router is None:
            return self._search(goal, held, rest, candidates)
        candidate, motions = self._router.route(rest, candidates, goal.duration)
        parts = [*motions, *self._fitted(candidate)]
        self._then(parts)
        self.caution = "" if candidate.holds else Cause.NOT_HOLDABLE
        seconds = sum(part.duration for part in parts)
        text = f"{seconds:.2f} s of motion in {len(parts)} parts"
        return f"{candidate.text or 'reached'}; {text}"

    def _line(self, goal: Goal, rest: Vector, at: Measured, held: str) -> str:
        path = self._finder.line(goal, rest, at)
        if path is None:
            self._then([AtRest(rest)])
            return "the tip is there already"
        candidate = Candidate(target=rest, paths=(path,))
        parts = self._fitted(candidate, goal.duration)
        ends = (self._robot.frame_pose(path.q[i], goal.tip).translation for i in (0, -1))
        length = float(np.linalg.norm(np.subtract(*ends)))
        text = f"straight path of {length:.3f} m; {parts[0].duration:.2f} s of motion"
        if self._router is not None:
            self._then(parts)
            return text
        return self._search(goal, held, rest, iter([replace(candidate, text=text)]))

    def _search(self, goal: Goal, held: str, rest: Vector, candidates: Iterator[Candidate]) -> str:
        candidate = next(candidates)
        search = PlannerSearch(
            goal=goal,
            held=held,
            rest=rest,
            candidates=candidates,
            candidate=candidate,
            bases=self._bases,
            request_id=self.queries.next_id(),
        )
        if candidate.is_at(rest) and not candidate.paths:
            self._then([AtRest(rest)])
            return candidate.text or "the joints are there already"
        self.queries.ask(search, self._player.clock.t)
        return f"{candidate.text}; asked the planner" if candidate.text else "asked the planner"

    def _fail(self, refusal: Refused | None) -> None:
        if refusal is not None:
            self._verdict = Outcome(state="failed", cause=refusal.cause, text=str(refusal))

    # The motion under way

    def _give_up(self, t: float, *, keeps_route: bool = False) -> JointMotion:
        """Forget what is under way, and return the joints at a time [s]."""
        self._route = self._route if keeps_route else None
        self._forget()
        return self._player.catch_up(t)

    def _forget(self) -> None:
        self.queries.cancel()
        self._settle, self._verdict = None, None
        self._blocked, self._route_ends, self.caution = "", 0.0, ""
        self._backs_off = False
        self._ready, self._bases = None, ()

    def _brake(self, now: JointMotion, *, hard: bool = False, touches: bool = False) -> Vector:
        holds = self.queries.load > 0.0 and not touches
        self._keeps_held = hard and holds
        return self._player.brake(now, hard=hard, holds=holds)

    def _then(self, parts: list[Trajectory]) -> None:
        self._keeps_held = False
        self._player.then(parts)
        self._watch()

    def _watch(self) -> None:
        trajectory = self._player.trajectory
        self._began_at, self.took = self._player.clock.t, None
        self._settle = SettleWatch(self._robot, self._settling, trajectory, self._tip)
