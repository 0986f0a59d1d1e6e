"""Control laws: pure classes behind one seam."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from stepbus_kinematics import Vector
from stepbus_participant import construct, read_class
from stepbus_participant.settings import Settings

from .robot import Robot, read_robot


class Reference(NamedTuple):
    """Where the joints should be: position, velocity, acceleration [rad, rad/s, rad/s²]."""

    position: Vector
    velocity: Vector
    acceleration: Vector


class Law(Protocol):
    """What a control law is, also a user's own.

    Constructed with the robot and the settings, out of which it reads its parameters. Every
    vector has shape (n,) and the order of `robot.joints`.
    """

    def __init__(self, robot: Robot, settings: Settings) -> None: ...

    def torque(self, q: Vector, v: Vector, reference: Reference, dt: float, /) -> Vector:
        """Return the torques to command [N·m]; the controller cuts them at the effort limits.

        q, v: positions and velocities [rad, rad/s]. dt: time between two calls [s].
        """
        ...


class PD:
    """τ = Kp (q_d − q) + Kd (v_d − v).

    kp [N·m/rad], kd [N·m·s/rad].
    """

    def __init__(self, robot: Robot, settings: Settings) -> None:
        self._kp = read_gain(settings, "kp", robot)
        self._kd = read_gain(settings, "kd", robot)

    def torque(self, q: Vector, v: Vector, reference: Reference, _dt: float) -> Vector:
        """See `Law`."""
        return self._kp * (reference.position - q) + self._kd * (reference.velocity - v)


class PID:
    """PD with an integral term, Ki ∫ (q_d − q) dt.

    kp [N·m/rad], ki [N·m/(rad·s)], kd [N·m·s/rad]. anti_windup: `conditional_integration` (the
    integral stands still while the torque exceeds its limit and the error would push it further;
    Åström and Hägglund, PID Controllers, 2nd ed. 1995, section 3.5) or `none`.
    """

    def __init__(self, robot: Robot, settings: Settings) -> None:
        self._pd = PD(robot, settings)
        self._ki = read_gain(settings, "ki", robot)
        words = ("conditional_integration", "none")
        anti_windup = settings.choice("anti_windup", words, default=words[0]) == words[0]
        self._integrate_within = robot.effort_limit if anti_windup else np.inf
        self._integral = np.zeros(len(robot.joints))

    def torque(self, q: Vector, v: Vector, reference: Reference, dt: float) -> Vector:
        """See `Law`."""
        error = reference.position - q
        proportional = self._pd.torque(q, v, reference, dt)
        integral = self._integral + self._ki * error * dt
        total = proportional + integral
        winds_up = (np.abs(total) > self._integrate_within) & (total * error > 0)
        if winds_up.any():
            integral[winds_up] = self._integral[winds_up]
        self._integral = integral
        return proportional + self._integral


class PDGravity:
    """PD with gravity compensation, τ = g(q) + Kp (q_d − q) + Kd (v_d − v).

    kp [N·m/rad], kd [N·m·s/rad]. Siciliano et al., Robotics, 2009, section 8.5.1.
    """

    def __init__(self, robot: Robot, settings: Settings) -> None:
        self._pd = PD(robot, settings)
        self._model = robot.require_model()

    def torque(self, q: Vector, v: Vector, reference: Reference, dt: float) -> Vector:
        """See `Law`."""
        return self._model.gravity_torque(q) + self._pd.torque(q, v, reference, dt)


class ComputedTorque:
    """τ = M(q) (a_d + Kp (q_d − q) + Kd (v_d − v)) + C(q, v) v + g(q).

    The error obeys ë + Kd ė + Kp e = 0, whatever the pose. kp [1/s²], kd [1/s]. Siciliano et al.,
    Robotics, 2009, section 8.5.2.
    """

    def __init__(self, robot: Robot, settings: Settings) -> None:
        self._pd = PD(robot, settings)
        self._model = robot.require_model()

    def torque(self, q: Vector, v: Vector, reference: Reference, dt: float) -> Vector:
        """See `Law`."""
        acceleration = reference.acceleration + self._pd.torque(q, v, reference, dt)
        return self._model.inverse_dynamics(q, v, acceleration)


def read_gain(settings: Settings, param: str, robot: Robot) -> Vector:
    """Return a gain, shape (n,): one number for all joints, a list, or a map by name."""
    return np.array(settings.per_name(param, robot.joints, bound="not negative"))


LAWS: dict[str, type[Law]] = {
    "computed_torque": ComputedTorque,
    "pd": PD,
    "pd_gravity": PDGravity,
    "pid": PID,
}
"""Value of `law` in the scenario → its class."""


def read_law(settings: Settings) -> tuple[Robot, Law]:
    """Return the robot and the law that the settings describe.

    Raises WiringError with all that is wrong with them.
    """
    law_class = read_class(settings, "law", LAWS, "torque")
    robot = read_robot(settings)
    law: Law | None = None
    if law_class is not None and robot is not None:
        law = construct(settings, "law", law_class, robot)
    if law is None or robot is None:
        if ":" not in str(settings.value("law", "")):
            settings.note_unknown(also_known=("kp", "ki", "kd", "anti_windup"))
        settings.refuse()
    settings.check()
    return robot, law
