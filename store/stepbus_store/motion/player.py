"""The motion of joints that is under way, also one that a planner has answered with."""

import math
from collections.abc import Sequence

import numpy as np

from stepbus_kinematics import RobotModel, SelfCollisions, Vector
from stepbus_schemas import Plan
from stepbus_store.cause import Cause
from stepbus_store.motion.fitting import is_strong_enough, sampled
from stepbus_store.motion.follow import JointPath
from stepbus_store.motion.joint_clock import MotionClock
from stepbus_store.motion.joint_motion import (
    JointMotion,
    ManipulatorOptions,
    Motion,
    MotionLimits,
    stop_from,
)
from stepbus_store.motion.outcome import Refused
from stepbus_store.motion.trajectory import AtRest, Joined, Retimed, Timed, Trajectory

_TOLERANCE = 1e-3
"""How far from where it should a plan may start and end [rad]."""


def planned(plan: Plan, start: Vector, goal: Vector, robot: RobotModel) -> Timed:
    """Return the motion of a plan, cubic between its samples.

    start, goal: where it must start and end, shape (n,) [rad]. Raises Refused with cause bad_plan
    for a plan from or to elsewhere.
    """
    rows = (plan.times, plan.position, plan.velocity)
    u, q, slope = (np.array(row, dtype=np.float64) for row in rows)
    for name, wanted, got in (("start", start, q[0]), ("end", goal, q[-1])):
        worst = int(np.argmax(np.abs(got - wanted)))
        if abs(got[worst] - wanted[worst]) > _TOLERANCE:
            joint, unit = robot.joints[worst], robot.unit(robot.joints[worst])
            text = f"plan {plan.id} has its {name} at {got[worst]:.4f} {unit} for {joint}"
            raise Refused(Cause.BAD_PLAN, f"{text}, not at {wanted[worst]:.4f} {unit}")
    # From exactly where the arm is: the error of rounding fades on the path.
    share = (u / u[-1])[:, np.newaxis]
    q += (1.0 - share) * (start - q[0]) + share * (goal - q[-1])
    return Timed(JointPath(u=u, q=np.clip(q, robot.lower, robot.upper), slope=slope))


_SHARES = (1.0, 0.5, 0.25)
"""Of the hardest braking, tried in this order."""

_SAMPLE_S = 0.008
"""Between two positions of the tip of which its acceleration is computed [s]."""

_ON_PATH = (1.0, 0.7, 0.5, 0.35, 0.25)
"""The same on a path, whose curves and own braking need a part of the limits."""

_GRIP_ACCELERATION = 6.0
"""Of the tip in a stop while the gripper holds something, unless the robot touches something:
harder, it would swing out of the pads [m/s²]."""


def _keeps_grip(motion: Motion, robot: RobotModel, tip: str) -> bool:
    count = max(math.ceil(motion.duration / _SAMPLE_S), 2)
    times = (n * motion.duration / count for n in range(count + 1))
    tips = [robot.frame_pose(motion.at(t).position, tip).translation for t in times]
    pushes = np.diff(tips, n=2, axis=0) / (motion.duration / count) ** 2
    return float(np.linalg.norm(pushes, axis=1).max()) <= _GRIP_ACCELERATION


def stop_on_path(trajectory: Trajectory, s: float, rate: float, limits: MotionLimits) -> Trajectory:
    """Return a stop of a trajectory that stays on its path.

    s: its time now [s]. rate: at which that runs. limits: of the joints.
    """
    now = JointMotion.of_one(s, rate, 0.0)
    speed = np.maximum(np.abs(trajectory.at(s).velocity), 1e-9)
    hardest = float((limits.acceleration / speed).min()), float((limits.jerk / speed).min())
    for share in _ON_PATH:
        timing = stop_from(now, MotionLimits.of_one(1.0, share * hardest[0], share * hardest[1]))
        motion = Retimed(trajectory, timing)
        pushes = np.abs([state.acceleration for state in sampled(motion, least=20)])
        if bool((pushes <= limits.acceleration * (1.0 + 1e-6)).all()):
            break
    return motion


class MotionPlayer:
    """The motion under way, and its clock.

    limits: of the joints. collisions: of the robot with itself when it stops; None: not checked.
    ignores_scale: the motion runs at full rate whatever the scale.
    """

    def __init__(
        self,
        robot: RobotModel,
        limits: MotionLimits,
        options: ManipulatorOptions,
        collisions: SelfCollisions | None = None,
    ) -> None:
        self._robot = robot
        self._collisions = collisions
        self._limits = limits
        self._period = options.period
        self._hardest = (options.brake_acceleration, options.brake_jerk)
        self._tip = options.tip
        self.clock = MotionClock(limits.acceleration, limits.jerk)
        self.trajectory: Trajectory = AtRest(np.zeros(len(robot.joints)))
        """The motion under way."""
        self._known: tuple[Trajectory | None, dict[float, JointMotion]] = None, {}
        self.ignores_scale = False

    def late(self, t: float) -> float:
        """Return the time since the end of the motion [s]; below 0: it is under way."""
        return self.clock.time_at(t) - self.trajectory.duration

    def advance(self, dt: float, scale: float) -> Vector:
        """Move the clock on by dt [s], its rate approaching a scale of 0 to 1; return joints."""
        wanted = 1.0 if self.ignores_scale else min(max(scale, 0.0), 1.0)
        self.clock.advance(dt, wanted, self.trajectory)
        self._known = None, {}
        return self._at(self.clock.s).position

    def _at(self, s: float) -> JointMotion:
        """Return the joints at a time of the motion [s]; a step asks for few, each many times."""
        if self._known[0] is not self.trajectory:
            self._known = self.trajectory, {}
        known = self._known[1]
        if s not in known:
            known[s] = self.trajectory.at(s)
        return known[s]

    def at(self, t: float) -> JointMotion:
        """Return the joints at a time [s]."""
        return self._at(self.clock.time_at(t)).scaled(self.clock.rate)

    def nominal(self) -> JointMotion:
        """Return the joints now, moving at the full rate."""
        return self._at(self.clock.s)

    def command(self, t: float) -> JointMotion:
        """Return what to command at a time [s].

        Its velocity takes the position to that of the next period, as position motors want it. A
        motion that ends at a limit may be beyond it by the rounding of its polynomials: clipped.
        """
        now, then = self.at(t), self.at(t + self._period)
        lower, upper = self._robot.lower, self._robot.upper
        position = np.clip(now.position, lower, upper)
        velocity = (np.clip(then.position, lower, upper) - position) / self._period
        return JointMotion(position=position, velocity=velocity, acceleration=now.acceleration)

    def catch_up(self, t: float) -> JointMotion:
        """Bring the clock to a time [s] and return the joints there: the next motion's start."""
        now = self.at(t)
        self.clock.catch_up(t)
        return now

    def start(self, trajectory: Trajectory) -> None:
        """Start a motion now; where the joints stand still, the clock keeps its rate."""
        moving = bool(trajectory.at(0.0).velocity.any())
        self.trajectory = trajectory
        self.clock.restart(1.0 if moving else self.clock.rate)
        self.ignores_scale = False

    def rest(self, q: Vector) -> None:
        """Stand still at q, shape (n,) [rad], clipped to the limits."""
        self.start(AtRest(np.clip(q, self._robot.lower, self._robot.upper)))

    def brake(self, now: JointMotion, *, hard: bool = False, holds: bool = False) -> Vector:
        """Start to come to rest; return where that will be, shape (n,) [rad].

        holds: it stops no harder than the gripper can hold something.
        """
        if not now.is_moving:
            self.start(AtRest(now.position))
            return now.position
        motion = self._stop(now, hard=hard, holds=holds)
        self.start(motion)
        self.clock.restart(1.0)
        self.ignores_scale = True
        return motion.at(motion.duration).position

    def _stop(self, now: JointMotion, *, hard: bool, holds: bool) -> Trajectory:
        """Return a stop: of each joint by itself, or on the path if the robot would touch itself.

        The path has been checked, the other stop leaves it.
        """
        motion = self._hard_stop(now, holds) if hard else stop_from(now, self._limits)
        if not self._touches(motion):
            return motion
        limits = self._limits.at_least(*self._hardest)
        on_path = stop_on_path(self.trajectory, self.clock.s, self.clock.rate, limits)
        return on_path if is_strong_enough(on_path, self._robot) else motion

    def _hard_stop(self, now: JointMotion, holds: bool) -> Motion:
        """Return the shortest of some stops that the motors, and the grip, are strong enough for.

        None is softer than the limits of the joints; the softest need not keep the grip.
        """
        for share in _SHARES:
            harder = self._limits.at_least(*(share * limit for limit in self._hardest))
            motion = stop_from(now, harder)
            keeps = not holds or _keeps_grip(motion, self._robot, self._tip)
            if keeps and is_strong_enough(motion, self._robot):
                return motion
        return stop_from(now, self._limits)

    def _touches(self, motion: Trajectory) -> bool:
        """Return whether a motion leads from where the robot does not touch itself to a touch."""
        if self._collisions is None:
            return False
        first, *states = (state.position for state in sampled(motion, least=20))
        return not self._collisions.any(first) and any(map(self._collisions.any, states))

    def then(self, parts: Sequence[Trajectory]) -> None:
        """Append motions to the braking under way; where it is over, start them."""
        if self.clock.s < self.trajectory.duration:
            self.trajectory = Joined([self.trajectory, *parts])
            self.ignores_scale = False
        else:
            self.start(Joined(parts))
