"""How a goal ends, and what is measured and reported meanwhile."""

from collections import deque
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stepbus_kinematics import JointOrder, RobotModel, Vector
from stepbus_schemas import (
    BaseState,
    Contacts,
    ControllerStatus,
    Description,
    GoalState,
    GoalStatus,
    GripperState,
    JointState,
    RunError,
)
from stepbus_store.cause import Cause


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The end of a goal; cause: one word for programs, text: one sentence for people."""

    state: Literal["succeeded", "failed"]
    cause: Cause | Literal[""] = ""
    text: str = ""


FARTHEST = 1e4
"""Largest length [m] and angle [rad] of a goal; beyond it numbers overflow."""


class Refused(RunError):
    """A goal that cannot be carried out; cause: one word for programs."""

    def __init__(self, cause: Cause, text: str) -> None:
        super().__init__(text)
        self.cause = cause


def failure_of(error: RunError) -> Outcome:
    """Return how a goal ends that cannot be carried out."""
    cause = error.cause if isinstance(error, Refused) else Cause.INVALID
    return Outcome(state="failed", cause=cause, text=str(error))


_NO_BASE = BaseState(x=0.0, y=0.0, yaw=0.0, vx=0.0, wz=0.0)
_NO_GRIPPER = GripperState(width=0.0, force=0.0, holding=False)
"""Of a robot that has none."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """The measurements of a step.

    q, v, effort: of the arm's joints, shape (n,) [rad, rad/s, N·m]. effort, contacts: None where
    nothing senses them.
    """

    q: Vector
    v: Vector
    effort: Vector | None = None
    base: BaseState = _NO_BASE
    gripper: GripperState = _NO_GRIPPER
    contacts: Contacts | None = None


class Reports:
    """Statuses and warnings that wait to be published."""

    def __init__(self) -> None:
        self._statuses: deque[GoalStatus] = deque()
        self._warnings: list[str] = []

    def status(self, number: int, state: GoalState, cause: str = "", text: str = "") -> None:
        """Add a status of a goal."""
        self._statuses.append(GoalStatus(id=number, state=state, cause=cause, text=text))

    def go_on(self, number: int, text: str) -> None:
        """Add a warning, and a status of the goal that goes on in spite of it."""
        self.status(number, "running", text=text)
        self.warn(text)

    def warn(self, *texts: str) -> None:
        """Add warnings; empty texts are none."""
        self._warnings += [text for text in texts if text]

    def next_status(self) -> GoalStatus | None:
        """Return the oldest status that was not published yet; None: there is none."""
        return self._statuses.popleft() if self._statuses else None

    def controller_status(self, error: Vector) -> ControllerStatus:
        """Return an error, shape (n,) [rad], with the warnings that were not published yet."""
        warnings, self._warnings = self._warnings, []
        saturated = [False] * len(error)
        return ControllerStatus(error=error.tolist(), saturated=saturated, warnings=warnings)


class JointSensor:
    """Maps the joints of an input to the robot's, and gives the robot the plant's effort limits.

    prefix: what the input puts before the robot's names. period: between two measurements [s].
    Raises WiringError for joints that the plant does not sense.
    """

    def __init__(
        self, port: str, described: Description, robot: RobotModel, *, period: float, prefix: str
    ) -> None:
        joints = [prefix + joint for joint in robot.joints]
        self._order = JointOrder(port, described.names, joints)
        effort = described.limits.get("effort")
        if effort is not None:
            robot.effort_limit = self._order.pick(effort, "effort limits")
        self._period = period
        self._before: Vector | None = None

    def read(self, state: JointState) -> Measured:
        """Return the joints as measured; velocities not sensed are derived from the positions.

        Raises RunError for a state that does not fit the description.
        """
        q = self._order.pick(state.position, "position")
        if state.velocity is not None:
            v = self._order.pick(state.velocity, "velocity")
        elif self._before is not None:
            v = (q - self._before) / self._period
        else:
            v = np.zeros_like(q)
        self._before = q
        effort = None if state.effort is None else self._order.pick(state.effort, "effort")
        return Measured(q=q, v=v, effort=effort)
