"""Control laws, and the robot data that they use."""

from collections.abc import Mapping
from dataclasses import dataclass
from operator import add, mul
from typing import Any, ClassVar, NamedTuple, Protocol, cast

import numpy as np

from stepbus_controller.params import GainParams, Params, PIDParams
from stepbus_kinematics import RobotModel, Values, Vector
from stepbus_participant import Config, PerName, make_plugin
from stepbus_schemas import WiringError

AnyReference = tuple[Values, Values, Values]


@dataclass(frozen=True, kw_only=True)
class Robot:
    """The controlled joints, in the order of every vector.

    effort_limit: torque limits, shape (n,) [N·m]. model: None if the scenario gives no model.
    """

    joints: tuple[str, ...]
    effort_limit: Vector
    model: RobotModel | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings about elements of an MJCF that the model leaves out; empty for a URDF."""
        robot = None if self.model is None else self.model.robot
        return robot.warnings if robot is not None and robot.format == "mjcf" else ()

    def require_model(self) -> RobotModel:
        """Return the model; raises WiringError if the scenario gives none."""
        if self.model is None:
            raise WiringError("this control law needs the robot's URDF; set params.model")
        return self.model


def make_robot(config: Config, params: Params) -> Robot:
    """Return the robot that the parameters describe.

    Raises SettingsError that lists the problems of the URDF, the joints and the effort limits.
    """
    problems = config.problems().below(("params",))
    model, joints = None, params.joints
    if params.model is not None:
        path = params.model
        model = problems.attempt(
            ("model",), lambda: RobotModel(path, joints, gravity=params.gravity)
        )
        problems.refuse()
        joints = model.joints if model is not None else joints
    names = joints or ()
    if params.effort_limit is not None:
        limit = np.array(params.effort_limit.of(names))
    else:
        limit = model.effort_limit if model is not None else np.zeros(len(names))
        for name, value in zip(names, limit.tolist(), strict=True):
            if not 0 < value < np.inf:
                unit = "N·m" if model is None else model.effort_unit(name)
                text = (
                    f"is {value:g} {unit} for joint {name!r} in the model; set a positive "
                    "limit here"
                )
                problems.add(("effort_limit",), text)
    problems.refuse()
    return Robot(joints=names, effort_limit=limit, model=model)


class Reference(NamedTuple):
    """Reference of the joints: position, velocity, acceleration [rad, rad/s, rad/s²]."""

    position: Vector
    velocity: Vector
    acceleration: Vector


class Law(Protocol):
    """The interface of a control law, built-in or your own.

    The constructor takes the robot and the parameters: those of this package, or for your own
    class an instance of its `Params`, or else a map. Every vector has shape (n,), in the order of
    `robot.joints`.
    """

    def __init__(self, robot: Robot, params: Any, /) -> None: ...

    def torque(self, q: Vector, v: Vector, reference: Reference, dt: float, /) -> Vector:
        """Return the torques to command [N·m]; the controller clips them at the effort limits.

        q, v: positions and velocities [rad, rad/s]. dt: time between two calls [s].
        """
        ...


class PD:
    """τ = Kp (q_d − q) + Kd (v_d − v); the base of all laws of this package.

    kp [N·m/rad], kd [N·m·s/rad]. integral: state of the integrator, shape (n,) [N·m]; empty
    without an integrator.
    """

    gains: ClassVar[Mapping[str, str]] = {"kp": "N·m/rad", "kd": "N·m·s/rad"}
    """The parameters that may change while it works, with their units."""

    def __init__(self, robot: Robot, params: GainParams) -> None:
        self._robot = robot
        self.integral: list[float] = []
        self.set_gains(params)

    def set_gains(self, params: Any) -> None:
        """Set the gains from parameters; the integral is kept."""
        joints = self._robot.joints
        gains = zip(params.kp.of(joints), params.kd.of(joints), strict=True)
        self._rows = [(number, kp, kd) for number, (kp, kd) in enumerate(gains)]

    def torque(self, q: Vector, v: Vector, reference: Reference, dt: float, /) -> Vector:
        """See `Law`."""
        return np.array(self.efforts(q, v, reference, dt))

    def efforts(self, q: Values, v: Values, reference: AnyReference, dt: float, /) -> list[float]:
        """Return the torques as a list: for few joints, lists are quicker than arrays."""
        q_d, v_d, _ = reference
        return [kp * (q_d[i] - q[i]) + kd * (v_d[i] - v[i]) for i, kp, kd in self._rows]


class PID(PD):
    """PD with an integral term, Ki ∫ (q_d − q) dt, and a feed-forward of acceleration, J a_d.

    ki [N·m/(rad·s)], feed_forward J [kg·m²]: commands the torque for the reference before an error
    builds up. anti_windup: `conditional_integration` (the integral stands still while the torque
    exceeds its limit and the error would push it further; Åström and Hägglund, PID Controllers,
    2nd ed. 1995, section 3.5) or `none`.
    """

    gains: ClassVar[Mapping[str, str]] = {
        **PD.gains,
        "ki": "N·m/(rad·s)",
        "feed_forward": "N·m·s²/rad",
    }

    def __init__(self, robot: Robot, params: PIDParams) -> None:
        super().__init__(robot, params)
        self.integral = [0.0] * len(robot.joints)
        anti_windup = params.anti_windup == "conditional_integration"
        limit = robot.effort_limit if anti_windup else np.full(len(self.integral), np.inf)
        self._integrate_within: list[float] = limit.tolist()

    def set_gains(self, params: Any) -> None:
        """See `PD`."""
        super().set_gains(params)
        self._ki: list[float] = params.ki.of(self._robot.joints)
        self._inertia: list[float] = params.feed_forward.of(self._robot.joints)

    def efforts(self, q: Values, v: Values, reference: AnyReference, dt: float, /) -> list[float]:
        """See `PD`."""
        torques = super().efforts(q, v, reference, dt)
        if any(self._inertia):
            torques = list(map(add, torques, map(mul, self._inertia, reference[2])))
        rows = zip(self._ki, self._integrate_within, self.integral.copy(), strict=True)
        for i, (ki, most, before) in enumerate(rows):
            error = reference[0][i] - q[i]
            integral = before + ki * error * dt
            total = torques[i] + integral
            winds_up = abs(total) > most and total * error > 0
            self.integral[i] = before if winds_up else integral
            torques[i] += self.integral[i]
        return torques


class PDGravity(PD):
    """PD with gravity compensation, τ = g(q) + Kp (q_d − q) + Kd (v_d − v).

    Siciliano et al., Robotics, 2009, section 8.5.1.
    """

    def efforts(self, q: Values, v: Values, reference: AnyReference, dt: float, /) -> list[float]:
        """See `PD`."""
        gravity = self._robot.require_model().gravity_torque(q).tolist()
        return list(map(add, gravity, super().efforts(q, v, reference, dt)))


class ComputedTorque(PD):
    """τ = M(q) (a_d + Kp (q_d − q) + Kd (v_d − v)) + C(q, v) v + g(q).

    The error obeys ë + Kd ė + Kp e = 0, whatever the pose. kp [1/s²], kd [1/s]. Siciliano et al.,
    Robotics, 2009, section 8.5.2.
    """

    gains: ClassVar[Mapping[str, str]] = {"kp": "1/s²", "kd": "1/s"}

    def efforts(self, q: Values, v: Values, reference: AnyReference, dt: float, /) -> list[float]:
        """See `PD`."""
        (q_d, v_d, a_d), rows = reference, self._rows
        a = [a_d[i] + (kp * (q_d[i] - q[i]) + kd * (v_d[i] - v[i])) for i, kp, kd in rows]
        torques: list[float] = self._robot.require_model().inverse_dynamics(q, v, a).tolist()
        return torques


LAWS: dict[str, type[PD]] = {
    "computed_torque": ComputedTorque,
    "pd": PD,
    "pd_gravity": PDGravity,
    "pid": PID,
}
"""Value of `law` in the scenario → its class."""


def make_law(config: Config, params: Params, robot: Robot) -> Law:
    """Return the law of the parameters; raises SettingsError that lists every problem."""
    if params.law not in LAWS:
        law: Law = make_plugin(config, "law", params.law, params.own, "torque", robot)
        return law
    check_gains(config, params, robot)
    return LAWS[params.law](robot, cast("GainParams", params))


def check_gains(config: Config, params: Params, robot: Robot) -> None:
    """Raise SettingsError that lists every gain that does not fit the joints."""
    problems = config.problems().below(("params",))
    for key in LAWS[params.law].gains:
        value: PerName = getattr(params, key)
        for where, text in value.misfits(robot.joints):
            problems.add((key, *where), text)
    problems.refuse()
