"""Control laws: pure classes behind one seam."""

from typing import Any, NamedTuple, Protocol

import numpy as np

from stepbus_controller import Params
from stepbus_kinematics import Vector
from stepbus_participant import Config, PerName, make_plugin

from .robot import Robot

NOTHING: Vector = np.zeros(0)


class Reference(NamedTuple):
    """Reference of the joints: position, velocity, acceleration [rad, rad/s, rad/s²]."""

    position: Vector
    velocity: Vector
    acceleration: Vector


class Law(Protocol):
    """A control law, also one of your own.

    It is made with the robot and its parameters: those of this package, or for a class of your own
    what its `Params` declares, else a map. Every vector has shape (n,) and the order of
    `robot.joints`.
    """

    def __init__(self, robot: Robot, params: Any, /) -> None: ...

    def torque(self, q: Vector, v: Vector, reference: Reference, dt: float, /) -> Vector:
        """Return the torques to command [N·m]; the controller clips them at the effort limits.

        q, v: positions and velocities [rad, rad/s]. dt: time between two calls [s].
        """
        ...


class Steered(Protocol):
    """A law whose gains may change while it works."""

    integral: Vector
    """What it has integrated, shape (n,) [N·m]; empty where it integrates nothing."""

    def set_gains(self, params: Params, /) -> None:
        """Take the gains of parameters; what the law has integrated stays."""


class PD:
    """τ = Kp (q_d − q) + Kd (v_d − v).

    kp [N·m/rad], kd [N·m·s/rad].
    """

    integral: Vector = NOTHING

    def __init__(self, robot: Robot, params: Params) -> None:
        self._robot = robot
        self.set_gains(params)

    def set_gains(self, params: Params) -> None:
        """See `Steered`."""
        robot = self._robot
        self._kp = _gain(params.kp, robot)
        self._kd = _gain(params.kd, robot)

    def torque(self, q: Vector, v: Vector, reference: Reference, _dt: float) -> Vector:
        """See `Law`."""
        return self._kp * (reference.position - q) + self._kd * (reference.velocity - v)


class PID:
    """PD with an integral term, Ki ∫ (q_d − q) dt, and a feed-forward of acceleration, J a_d.

    kp [N·m/rad], ki [N·m/(rad·s)], kd [N·m·s/rad], feed_forward J [kg·m²]: the torque that the
    reference takes is commanded before there is an error. anti_windup: `conditional_integration`
    (the integral stands still while the torque exceeds its limit and the error would push it
    further; Åström and Hägglund, PID Controllers, 2nd ed. 1995, section 3.5) or `none`.
    """

    def __init__(self, robot: Robot, params: Params) -> None:
        self._robot = robot
        self._pd = PD(robot, params)
        self.set_gains(params)
        anti_windup = params.anti_windup == "conditional_integration"
        self._integrate_within = robot.effort_limit if anti_windup else np.inf
        self.integral: Vector = np.zeros(len(robot.joints))

    def set_gains(self, params: Params) -> None:
        """See `Steered`."""
        self._pd.set_gains(params)
        self._ki = _gain(params.ki, self._robot)
        self._inertia = _gain(params.feed_forward, self._robot)

    def torque(self, q: Vector, v: Vector, reference: Reference, dt: float) -> Vector:
        """See `Law`."""
        error = reference.position - q
        proportional = self._pd.torque(q, v, reference, dt)
        if self._inertia.any():
            proportional = proportional + self._inertia * reference.acceleration
        integral = self.integral + self._ki * error * dt
        total = proportional + integral
        winds_up = (np.abs(total) > self._integrate_within) & (total * error > 0)
        if winds_up.any():
            integral[winds_up] = self.integral[winds_up]
        self.integral = integral
        return proportional + self.integral


class PDGravity:
    """PD with gravity compensation, τ = g(q) + Kp (q_d − q) + Kd (v_d − v).

    kp [N·m/rad], kd [N·m·s/rad]. Siciliano et al., Robotics, 2009, section 8.5.1.
    """

    integral: Vector = NOTHING

    def __init__(self, robot: Robot, params: Params) -> None:
        self._pd = PD(robot, params)
        self.set_gains = self._pd.set_gains
        self._model = robot.require_model()

    def torque(self, q: Vector, v: Vector, reference: Reference, dt: float) -> Vector:
        """See `Law`."""
        return self._model.gravity_torque(q) + self._pd.torque(q, v, reference, dt)


class ComputedTorque:
    """τ = M(q) (a_d + Kp (q_d − q) + Kd (v_d − v)) + C(q, v) v + g(q).

    The error obeys ë + Kd ė + Kp e = 0, whatever the pose. kp [1/s²], kd [1/s]. Siciliano et al.,
    Robotics, 2009, section 8.5.2.
    """

    integral: Vector = NOTHING

    def __init__(self, robot: Robot, params: Params) -> None:
        self._pd = PD(robot, params)
        self.set_gains = self._pd.set_gains
        self._model = robot.require_model()

    def torque(self, q: Vector, v: Vector, reference: Reference, dt: float) -> Vector:
        """See `Law`."""
        acceleration = reference.acceleration + self._pd.torque(q, v, reference, dt)
        return self._model.inverse_dynamics(q, v, acceleration)


LAWS: dict[str, type[Law]] = {
    "computed_torque": ComputedTorque,
    "pd": PD,
    "pd_gravity": PDGravity,
    "pid": PID,
}
"""Value of `law` in the scenario → its class."""


def make_law(config: Config, params: Params, robot: Robot) -> Law:
    """Return the law that the parameters name; raises SettingsError with all that is wrong."""
    law: Law
    if params.law in LAWS:
        check_gains(config, params, robot)
        law = LAWS[params.law](robot, params)
    else:
        law = make_plugin(config, "law", params.law, params.own, "torque", robot)
    return law


def gains_of(params: Params) -> tuple[str, ...]:
    """Return the gains of a law of this package; none of a law of one's own."""
    if params.law not in LAWS:
        return ()
    return ("kp", "kd", "ki", "feed_forward") if params.law == "pid" else ("kp", "kd")


def check_gains(config: Config, params: Params, robot: Robot) -> None:
    """Raise SettingsError that lists every gain that does not fit the joints."""
    problems = config.problems().below(("params",))
    for key in gains_of(params):
        value: PerName = getattr(params, key)
        for where, text in value.misfits(robot.joints):
            problems.add((key, *where), text)
    problems.refuse()


def _gain(value: PerName, robot: Robot) -> Vector:
    """Return a gain of each joint, shape (n,)."""
    return np.array(value.of(robot.joints))
