"""A gripper: carries out its goals, and weighs what it holds by the torques of the arm."""

import math

import msgspec
import numpy as np

from stepbus_kinematics import RobotModel, Vector
from stepbus_schemas import Goal, GripperCommand, GripperState
from stepbus_store.cause import Cause
from stepbus_store.motion.mobile.params import Params
from stepbus_store.motion.outcome import Outcome, Refused

_SLOW = 0.3
"""Velocity up to which the torques of an arm are those of its weight [rad/s]."""

_SETTLES_IN = 0.15
"""Time constant of the mean, which evens out how the motors settle [s]."""

_LEAST_LEVER = 0.2
"""Torques per mass below which a pose tells nothing about a load [m]."""

_GRAVITY = 9.81
"""[m/s²]"""

_RESOLUTION = 0.01
"""[kg]"""

_STILL, _STILL_FOR = 2e-4, 0.1
"""Largest change of the width of fingers that stand still [m], and the time that counts [s]."""

_PATIENCE = 0.5
"""Time that the fingers may stand still short of the goal [s]."""

_IS_JAMMED = ": is one finger jammed?"
"""They are coupled: where one is jammed, the other does not move either."""

_RAISE_BY = 1.25
"""Factor on the force when what is held slips."""

_RESERVE = 1.5
"""Factor on the force that holds the weight."""


class Scale:
    """Weighs a point mass at a frame, whenever the arm is slow: it explains the torques best."""

    def __init__(self, robot: RobotModel, frame: str) -> None:
        self._robot = robot
        self._number = robot.frame_id(frame)
        self._mean = 0.0
        self.load = 0.0
        """Mass of what the gripper holds, as far as it is known [kg]."""

    def clear(self) -> None:
        """Forget the load: the gripper holds nothing."""
        self._mean = self.load = 0.0

    def weigh(self, q: Vector, v: Vector, effort: Vector, dt: float) -> None:
        """Weigh by what was measured dt [s] after the last time.

        q, v, effort: of the joints, shape (n,) [rad, rad/s, N·m].
        """
        _, jacobian = self._robot.jacobian(q, self._number)
        lever = jacobian[2]
        size = float(lever @ lever)
        if float(np.abs(v).max()) <= _SLOW and size >= _LEAST_LEVER**2:
            excess = effort - self._robot.gravity_torque(q)
            mass = self._robot.load + float(lever @ excess) / (size * _GRAVITY)
            self._mean += (mass - self._mean) * (1.0 - math.exp(-dt / _SETTLES_IN))
        if abs(self._mean - self.load) > _RESOLUTION:
            self.load = max(round(self._mean / _RESOLUTION) * _RESOLUTION, 0.0)


class Gripper:
    """Carries out `grip` goals, one at a time.

    A goal is done when the width is reached, or when the fingers stand still because they hold
    something. What they hold is gripped with little force at first, and with more, up to that of
    the goal, whenever it slips, and as its weight needs it.
    """

    def __init__(self, params: Params) -> None:
        self._params = params
        self._state = GripperState(width=0.0, force=0.0, holding=False)
        self._command = self._keep(self._state)
        self._goal: GripperCommand | None = None
        self._anchor = 0.0
        self._still_since = 0.0
        self._began_at = 0.0
        self._holds_width: float | None = None
        self._loose_since: float | None = None
        self._most = 0.0
        self._slipped = 0.0

    @property
    def holds(self) -> bool:
        """Return whether the last goal ended with something between the pads, still there."""
        return self._holds_width is not None

    def hold(self, state: GripperState) -> None:
        """Keep the fingers where they are."""
        self._state = state
        self._command = self._keep(state)

    def _keep(self, state: GripperState) -> GripperCommand:
        width = min(max(state.width, 0.0), self._params.gripper_widest)
        return GripperCommand(width=width, force=self._params.gripper_force)

    def start(self, goal: Goal, t: float) -> str:
        """Start a goal at t [s], return a sentence; raises Refused for what is out of range."""
        state, widest = self._state, self._params.gripper_widest
        if not 0.0 <= goal.width <= widest:
            text = f"width {goal.width:g} m is out of reach (0 to {widest:g} m)"
            raise Refused(Cause.INVALID, text)
        if not (math.isfinite(goal.force) and goal.force > 0.0):
            raise Refused(Cause.INVALID, f"force {goal.force:g} N would not move the fingers")
        closes, self._most, self._slipped = goal.width < state.width, goal.force, 0.0
        force = min(self._params.first_force, goal.force) if closes else goal.force
        self._goal = self._command = GripperCommand(width=goal.width, force=force)
        self._anchor = self._began_at = state.width
        self._still_since = t
        self._holds_width = self._loose_since = None
        verb, most = ("close", f" to {goal.force:.1f}") if closes else ("open", "")
        return f"{verb} from {_mm(state.width)} to {_mm(goal.width)} with {force:.1f}{most} N"

    def secure(self, load: float) -> None:
        """Grip harder where what is held has slid, or its mass, as far as known [kg], needs it."""
        state, command, params = self._state, self._command, self._params
        if not (state.holding and (self._goal is not None or self.holds)):
            return
        needed = _RESERVE * load * _GRAVITY / (2.0 * params.pad_friction)
        force = max(command.force, needed)
        if state.slip > self._slipped + params.slip:
            force = max(force, command.force * _RAISE_BY)
            self._slipped = state.slip
        self._slipped = min(self._slipped, state.slip)
        force = min(force, max(self._most, command.force))
        if force > command.force:
            self._command = msgspec.structs.replace(command, force=force)

    def interrupt(self, state: GripperState) -> None:
        """Give up a goal, with the fingers where they are now."""
        self._state = state
        self.stop()

    def stop(self) -> None:
        """Leave the fingers where they are; they keep what they hold."""
        if self._goal is not None and self._state.holding:
            self._holds_width = self._state.width
        elif self._goal is not None:
            self._command = self._keep(self._state)
        self._goal = None

    def command(self) -> GripperCommand:
        """Return the command of this step."""
        return self._command

    def check(self, state: GripperState, t: float) -> Outcome | None:
        """Compare with what was measured at a time [s]; return how the goal ended, once it has."""
        self._state = state
        if abs(state.width - self._anchor) > _STILL:
            self._anchor, self._still_since = state.width, t
        if self._goal is None:
            return None
        outcome = self._judge(self._goal, state, t - self._still_since)
        if outcome is not None:
            self._goal = None
        return outcome

    def _judge(self, goal: GripperCommand, state: GripperState, still: float) -> Outcome | None:
        is_still, tolerance = still >= _STILL_FOR - 1e-9, self._params.gripper_tolerance
        opens = goal.width > self._began_at + tolerance
        if is_still and state.holding and not opens:
            self._holds_width = state.width
            text = f"held: {_mm(state.width)} wide, {state.force:.1f} N"
            return Outcome(state="succeeded", text=text)
        is_free = not state.holding and goal.width > self._began_at
        if (is_still or is_free) and abs(state.width - goal.width) <= tolerance:
            return Outcome(state="succeeded", text=f"{_mm(state.width)} wide, holds nothing")
        if still < _PATIENCE:
            return None
        moved = abs(state.width - self._began_at)
        did = "have not moved" if moved <= _STILL else f"stopped after {_mm(moved)}"
        text = (
            f"the fingers {did}: {_mm(state.width)} wide instead of {_mm(goal.width)}, "
            f"{state.force:.1f} N of {goal.force:.1f} N, "
            f"{'something' if state.holding else 'nothing'} between them{_IS_JAMMED}"
        )
        return Outcome(state="failed", cause=Cause.STUCK, text=text)

    def lost(self, t: float) -> str:
        """Return a sentence once what was held has slipped out, else nothing; call it each step."""
        if self._holds_width is None or self._goal is not None:
            return ""
        state = self._state
        if state.holding:
            self._loose_since = None
            return ""
        self._loose_since = t if self._loose_since is None else self._loose_since
        if t - self._loose_since < _STILL_FOR - 1e-9:
            return ""
        held, self._holds_width, self._loose_since = self._holds_width, None, None
        return (
            f"what was held at {_mm(held)} is lost: the pads are {_mm(state.width)} apart and "
            f"press with {state.force:.1f} N{_IS_JAMMED if state.width > held - _STILL else ''}"
        )


def _mm(length: float) -> str:
    return f"{length * 1e3:.1f} mm"
