"""Spirals of the tip."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import Vector
from stepbus_schemas import Goal
from stepbus_store.cause import Cause
from stepbus_store.motion.branches import BranchSolver
from stepbus_store.motion.follow import (
    EVERY_M,
    Candidate,
    JointPath,
    PathLost,
    TipPose,
    check_path,
    follow,
    line,
)
from stepbus_store.motion.outcome import FARTHEST, Refused


@dataclass(frozen=True, kw_only=True)
class SpiralCurve:
    """A spiral around a vertical, from one radius to another, gaining height evenly.

    centre: x, y, z in the robot's base; z is the height of its start [m]. radius: at its start
    and its end [m]. turns: counter-clockwise, below 0: clockwise. rise: [m]. starts_at: angle of
    its first point [rad]. rotation: of the tip, shape (3, 3). raised: height added at each of its
    points, shape (k,) [m]; between two points the height blends smoothly.
    """

    centre: Vector
    radius: tuple[float, float]
    turns: float
    rise: float
    starts_at: float
    rotation: Vector
    raised: Vector

    def at(self, share: float) -> tuple[Any, Vector]:
        """Return the pose at a share of the angle, and the velocity by that share, shape (3,)."""
        sweep = 2 * math.pi * self.turns
        widening = self.radius[1] - self.radius[0]
        radius = self.radius[0] + share * widening
        angle = self.starts_at + share * sweep
        cos, sin = math.cos(angle), math.sin(angle)
        lift, lifting = self._lift(share)
        x, y, z = self.centre
        point = np.array([x + radius * cos, y + radius * sin, z + share * self.rise + lift])
        vx = widening * cos - radius * sweep * sin
        vy = widening * sin + radius * sweep * cos
        return pin.SE3(self.rotation, point), np.array([vx, vy, self.rise + lifting])

    def _lift(self, share: float) -> tuple[float, float]:
        """Return the height that is added, and its derivative by the share."""
        gaps = len(self.raised) - 1
        gap = min(int(share * gaps), gaps - 1)
        x = share * gaps - gap
        low, high = float(self.raised[gap]), float(self.raised[gap + 1])
        blend = x**3 * (10 - 15 * x + 6 * x * x)
        slope = 30 * (x * (1 - x)) ** 2 * gaps
        return low + (high - low) * blend, (high - low) * slope

    def poses(self) -> list[TipPose]:
        """Return the path over its length, by Simpson's rule."""
        coarse = max(self.radius) * 2 * math.pi * abs(self.turns) + abs(self.rise)
        coarse += float(np.abs(np.diff(self.raised)).sum()) + abs(self.radius[1] - self.radius[0])
        # A whole number of poses between two points, so that no blend is cut in two.
        gaps = len(self.raised) - 1
        count = gaps * max(math.ceil(coarse / EVERY_M / gaps), 2)
        shares = [i / count for i in range(count + 1)]
        rows = [self.at(share) for share in shares]
        speeds = [float(np.linalg.norm(velocity)) for _, velocity in rows]
        halves = [float(np.linalg.norm(self.at((i + 0.5) / count)[1])) for i in range(count)]
        poses, u = [], 0.0
        for i, (pose, velocity) in enumerate(rows):
            twist = np.concatenate([velocity / speeds[i], np.zeros(3)])
            poses.append(TipPose(u=u, pose=pose, twist=twist))
            if i < count:
                u += (speeds[i] + 4 * halves[i] + speeds[i + 1]) / (6 * count)
        return poses


_RAISE_BY, _MOST_RAISED = 0.05, 0.5
"""How far a point that is out of reach is raised at a time, and at most [m]."""

_POINTS_PER_TURN = 24
_MOST_TURNS = 100
_MOST_STARTS = 16
"""Solutions at the first point that are tried; full turns of joints count."""


class SpiralPlanner:
    """Finds joints along spirals, for each solution at the first point; turn_radius: see `line`."""

    def __init__(self, solver: BranchSolver, turn_radius: float) -> None:
        self._robot, self._solver = solver.robot, solver
        self._turn_radius = turn_radius

    def solve(self, goal: Goal, frame: Any, target: Any, q: Vector) -> Iterator[Candidate]:
        """Yield paths that the joints can follow, the one nearest to q, shape (n,) [rad], first.

        frame: of the goal, target: of the tip at the end, both `pinocchio.SE3` in the robot's base.
        Raises Refused for a goal that is no spiral, and where the joints can follow none.
        """
        spiral = self._raised(goal.tip, self._read(goal, frame, target, q), q)
        starts = self._solver.solve(goal.tip, spiral.at(0.0)[0], q)
        problem: Refused | None = None
        works = False
        for start in starts[:_MOST_STARTS]:
            try:
                candidate = self._path(goal.tip, spiral, start, target)
                for path in candidate.paths:
                    check_path(path, self._solver.collisions)
            except Refused as exc:
                problem = problem or exc
            else:
                works = True
                yield candidate
        if not works and problem is not None:
            raise problem

    def _read(self, goal: Goal, frame: Any, target: Any, q: Vector) -> SpiralCurve:
        wanted = goal.spiral
        if wanted is None:
            raise Refused(Cause.INVALID, "type spiral needs spiral: centre, radius, turns")
        numbers = (*wanted.centre, *wanted.radius, wanted.turns, wanted.rise)
        is_small = all(abs(number) <= FARTHEST for number in numbers)
        if not (is_small and min(wanted.radius) > 0 and 0 < abs(wanted.turns) <= _MOST_TURNS):
            text = (
                f"radius {wanted.radius}, turns {wanted.turns:g} and rise {wanted.rise:g} make no"
            )
            needs = f"radii above 0 and up to {_MOST_TURNS} turns, other than 0, are needed"
            raise Refused(Cause.INVALID, f"{text} spiral: {needs}")
        centre = frame.act(np.array(wanted.centre))
        beside = self._robot.frame_pose(q, goal.tip).translation - centre
        # From the side where the tip is; right above the centre any side is as good.
        near = math.hypot(beside[0], beside[1]) < 1e-3
        points = max(math.ceil(_POINTS_PER_TURN * abs(wanted.turns)), 2)
        return SpiralCurve(
            centre=centre,
            radius=wanted.radius,
            turns=wanted.turns,
            rise=wanted.rise,
            starts_at=0.0 if near else math.atan2(beside[1], beside[0]),
            rotation=target.rotation,
            raised=np.zeros(points + 1),
        )

    def _raised(self, tip: str, spiral: SpiralCurve, q: Vector) -> SpiralCurve:
        """Return the spiral with its points raised until each is within reach."""
        raised = spiral.raised.copy()
        gaps = len(raised) - 1
        for index in range(gaps + 1):
            pose, _ = spiral.at(index / gaps)
            while not self._solver.is_reachable(tip, pose, q):
                if raised[index] >= _MOST_RAISED - 1e-9:
                    text = f"point {index} of the spiral, also raised by {_MOST_RAISED:g} m"
                    raise Refused(Cause.UNREACHABLE, f"unreachable: {text}")
                raised[index] += _RAISE_BY
                pose.translation = pose.translation + np.array([0, 0, _RAISE_BY])
        return replace(spiral, raised=raised)

    def _path(self, tip: str, spiral: SpiralCurve, start: Vector, target: Any) -> Candidate:
        spiral, around = self._around(tip, spiral, start)
        paths = [around]
        rest = line(spiral.at(1.0)[0], target, self._turn_radius)
        if rest:
            paths.append(follow(self._robot, tip, rest, around.q[-1]))
        count = int(np.count_nonzero(spiral.raised))
        text = f"spiral of {spiral.turns:g} turns and {float(around.u[-1]):.2f} m"
        if count:
            by = float(spiral.raised.max())
            text += f", {count} of its {len(spiral.raised)} points raised by up to {by:.2f} m"
        if rest:
            text += f", then {rest[-1].u:.2f} m straight"
        return Candidate(target=start, paths=tuple(paths), text=text)

    def _around(
        self, tip: str, spiral: SpiralCurve, start: Vector
    ) -> tuple[SpiralCurve, JointPath]:
        """Return the joints along a spiral; raises the points where they cannot follow."""
        gaps = len(spiral.raised) - 1
        while True:
            poses = spiral.poses()
            try:
                return spiral, follow(self._robot, tip, poses, start)
            except PathLost as exc:
                index = min(exc.index * gaps // (len(poses) - 1), gaps - 1)
                raised = spiral.raised.copy()
                # The first point stays: this solution is for it.
                raised[max(index, 1) : index + 2] += _RAISE_BY
                if exc.cause == Cause.LIMITS or raised.max() > _MOST_RAISED + 1e-9:
                    raise
                spiral = replace(spiral, raised=raised)
