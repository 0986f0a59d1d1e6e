"""Control laws, and the robot data that they use."""

from collections.abc import Mapping
from dataclasses import dataclass
from operator import add
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
        self.integral: Vector = np.zeros(0)
        self.set_gains(params)

    def set_gains(self, params: Any) -> None:
        """Set the gains from parameters; the integral is kept."""
        self._kp: list[float] = params.kp.of(self._robot.joints)
        self._kd: list[float] = params.kd.of(self._robot.joints)

    def torque(self, q: Vector, v: Vector, reference: Reference, dt: float, /) -> Vector:
        """See `Law`."""
        return np.array(self.efforts(q, v, reference, dt))

    def efforts(self, q: Values, v: Values, reference: AnyReference, dt: float, /) -> list[float]:
        """Return the torques as a list: for few joints, lists are quicker than arrays."""
        rows = zip(self._kp, self._kd, *reference[:2], q, v, strict=True)
        return [kp * (q_d - q) + kd * (v_d - v) for kp, kd, q_d, v_d, q, v in rows]


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
        self.integral = np.zeros(len(robot.joints))
        anti_windup = params.anti_windup == "conditional_integration"
        self._integrate_within = robot.effort_limit if anti_windup else np.inf

    def set_gains(self, params: Any) -> None:
        """See `PD`."""
        super().set_gains(params)
        self._ki = np.array(params.ki.of(self._robot.joints))
        self._inertia = np.array(params.feed_forward.of(self._robot.joints))

    def efforts(self, q: Values, v: Values, reference: AnyReference, dt: float, /) -> list[float]:
        """See `PD`."""
        error = np.subtract(reference[0], q)
        proportional = np.array(super().efforts(q, v, reference, dt))
        if self._inertia.any():
            proportional = proportional + self._inertia * reference[2]
        integral = self.integral + self._ki * error * dt
        total = proportional + integral
        winds_up = (np.abs(total) > self._integrate_within) & (total * error > 0)
        if winds_up.any():
            integral[winds_up] = self.integral[winds_up]
        self.integral = integral
        return cast("list[float]", (proportional + integral).tolist())


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
        rows = zip(self._kp, self._kd, *reference, q, v, strict=True)
        a = [a_d + (kp * (q_d - q) + kd * (v_d - v)) for kp, kd, q_d, v_d, a_d, q, v in rows]
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
