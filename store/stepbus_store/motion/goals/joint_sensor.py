"""Reads the joints of an arm from what the plant senses."""

from typing import NamedTuple

import numpy as np

from stepbus_kinematics import JointOrder, RobotModel, Smoother, Vector
from stepbus_schemas import Description, JointState, WiringError


class JointReading(NamedTuple):
    """q, v: smoothed; position, effort: as measured. Each of shape (n,) [rad, rad/s, N·m].

    effort: None where it is not sensed.
    """

    q: Vector
    v: Vector
    position: Vector
    effort: Vector | None = None


class JointSensor:
    """Maps the joints of an input to the robot's, and gives the robot the plant's effort limits.

    name: of the participant, for messages. prefix: what the input puts before the robot's names.
    period: between two measurements [s]. smoother: None:
    no smoothing. Raises WiringError for joints that the plant does not sense.
    """

    def __init__(
        self,
        name: str,
        port: str,
        described: Description,
        robot: RobotModel,
        *,
        period: float,
        prefix: str = "",
        smoother: Smoother | None = None,
    ) -> None:
        try:
            self._order = JointOrder(
                port, described.names, [prefix + joint for joint in robot.joints]
            )
        except WiringError as exc:
            lines = [f"{name}: {line}" for line in str(exc).splitlines()]
            raise WiringError("\n".join(lines)) from exc
        effort = described.limits.get("effort")
        if effort is not None:
            robot.effort_limit = self._order.pick(effort, "effort limits")
        self._period = period
        self._smoother = smoother
        self._before: Vector | None = None

    def read(self, state: JointState) -> JointReading:
        """Return the joints; velocities come from positions where they are not sensed or smoothed.

        Raises RunError for a state that does not fit the description.
        """
        position = self._order.pick(state.position, "position")
        q = position if self._smoother is None else self._smoother.update(position)
        if self._smoother is None and state.velocity is not None:
            v = self._order.pick(state.velocity, "velocity")
        elif self._before is not None:
            v = (q - self._before) / self._period
        else:
            v = np.zeros_like(q)
        self._before = q
        effort = None if state.effort is None else self._order.pick(state.effort, "effort")
        return JointReading(q=q, v=v, position=position, effort=effort)
