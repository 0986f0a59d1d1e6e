"""Trajectories: joints over time, from rest or from a motion, to rest."""

from collections.abc import Sequence
from typing import Protocol

from stepbus_kinematics import Vector
from stepbus_store.motion.follow import JointPath
from stepbus_store.motion.joint_motion import JointMotion, Motion, MotionLimits, motion_to


class Trajectory(Protocol):
    """Joints over time, coming to rest; duration: [s]. After it they stay where they are."""

    duration: float

    def at(self, t: float) -> JointMotion:
        """Return the joints at a time since its start [s]."""
        ...


class Timed:
    """A path whose parameter is the time from 0 on [s]."""

    def __init__(self, path: JointPath) -> None:
        self._path = path
        self.duration: float = float(path.u[-1])

    def at(self, t: float) -> JointMotion:
        """See `Trajectory`."""
        if t >= self.duration:
            return JointMotion.at_rest(self._path.q[-1].copy())
        q, slope, curve = self._path.at(t)
        return JointMotion(position=q, velocity=slope, acceleration=curve)


class Retimed:
    """The same path, with the time of a trajectory as the motion of that time has it [s]."""

    def __init__(self, trajectory: Trajectory, timing: Motion) -> None:
        self._trajectory = trajectory
        self._timing = timing
        self.duration: float = timing.duration

    def at(self, t: float) -> JointMotion:
        """See `Trajectory`."""
        now = self._timing.at(t)
        s, rate, push = (float(row[0]) for row in (now.position, now.velocity, now.acceleration))
        there = self._trajectory.at(s)
        return JointMotion(
            position=there.position,
            velocity=there.velocity * rate,
            acceleration=there.acceleration * rate**2 + there.velocity * push,
        )


def along_path(path: JointPath, limits: MotionLimits) -> Trajectory:
    """Return the motion along a path from rest to rest; limits: of its parameter, shape (1,)."""
    timing = motion_to(JointMotion.at_rest(path.u[:1].copy()), path.u[-1:].copy(), limits)
    return Retimed(Timed(path), timing)


class Stretched:
    """The same motion in `factor` times the duration."""

    def __init__(self, trajectory: Trajectory, factor: float) -> None:
        self._trajectory = trajectory
        self._factor = factor
        self.duration: float = trajectory.duration * factor

    def at(self, t: float) -> JointMotion:
        """See `Trajectory`."""
        return self._trajectory.at(t / self._factor).scaled(1.0 / self._factor)


class Joined:
    """Motions one after the other; each starts at rest where the one before ends."""

    def __init__(self, parts: Sequence[Trajectory]) -> None:
        self._parts = list(parts)
        self.duration: float = sum(part.duration for part in parts)

    def at(self, t: float) -> JointMotion:
        """See `Trajectory`."""
        for part in self._parts[:-1]:
            if t < part.duration:
                return part.at(t)
            t -= part.duration
        return self._parts[-1].at(t)


class AtRest:
    """Standing still at positions of shape (n,) [rad]."""

    def __init__(self, q: Vector) -> None:
        self._now = JointMotion.at_rest(q.copy())
        self.duration: float = 0.0

    def at(self, t: float) -> JointMotion:
        """See `Trajectory`."""
        return self._now
