"""The controller as a participant: reads the joints, applies the law, commands torques."""

import math
from collections.abc import Mapping
from typing import Any, cast

import msgspec
import numpy as np

from stepbus_controller import Params
from stepbus_controller.laws import LAWS, Reference, Steered, check_gains, gains_of, make_law
from stepbus_controller.robot import make_robot
from stepbus_controller.velocity import Sample, VelocityEstimator, make_estimator
from stepbus_kinematics import Smoother, Vector, delay_warning, joint_orders, make_smoother
from stepbus_participant import (
    Config,
    Method,
    Participant,
    Ports,
    Steering,
    Step,
    installed_version,
)
from stepbus_schemas import (
    ControllerStatus,
    Description,
    JointCommand,
    JointReference,
    JointState,
    Message,
    RunError,
    due_step,
)

TORQUE_UNITS = {
    "kp": "N·m/rad",
    "kd": "N·m·s/rad",
    "ki": "N·m/(rad·s)",
    "feed_forward": "N·m·s²/rad",
}
ACCELERATION_UNITS = {"kp": "1/s²", "kd": "1/s"}


class Saved(msgspec.Struct):
    """The state of a controller at a checkpoint; vectors of shape (n,).

    params: with the gains that calls have set. integral: of the law. estimator, smoothers: what
    they remember. motion: positions and velocities. position: as measured. reference: positions,
    velocities and accelerations.
    """

    params: dict[str, Any]
    integral: list[float]
    estimator: list[Sample]
    smoothers: list[list[list[float]]]
    motion: list[list[float]] | None
    position: list[float] | None
    reference: list[list[float]] | None
    saturated: list[bool]
    has_reported_delay: bool


class Controller(Participant):
    """Commands joint torques by a control law, clipped at the effort limits.

    Inputs: one JointState/1 and one JointReference/1. Outputs: one JointCommand/1 and, where the
    scenario wires it, one ControllerStatus/1. The scenario names the ports. Nothing is published
    until both inputs have come once. Its gains can be read and set by calls. The status reports the
    delay of `smoothing` once. Parameters: see `Params`.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        ports = Ports(config)
        self._state_port = ports.input_of("JointState/1")
        self._reference_port = ports.input_of("JointReference/1")
        self._command_port = ports.output_of("JointCommand/1")
        self._status_port = ports.optional_output_of("ControllerStatus/1")
        ports.outputs_are("JointCommand/1", "ControllerStatus/1")
        params = config.read(Params, ports.problems)
        self._estimator: VelocityEstimator | None = make_estimator(params)
        sensed_s = max(config.every, config.inputs[self._state_port].every) * config.step_ns * 1e-9
        filters = (params.smoothing, params.time_constant, params.window, sensed_s)
        self._smoother: Smoother | None = make_smoother(*filters)
        self._velocity_smoother: Smoother | None = make_smoother(*filters)
        self._robot = make_robot(config, params)
        self._names = [params.prefix + joint for joint in self._robot.joints]
        self.law = make_law(config, params, self._robot)
        self._steering = Steering(config, Params, self._gains(params), self._set_gains)
        self._limit: list[float] = self._robot.effort_limit.tolist()
        self._dt = config.every * config.step_ns * 1e-9
        self._motion: tuple[Vector, Vector] | None = None
        self._position: Vector | None = None
        self._reference: Reference | None = None
        self._saturated = [False] * len(self._limit)
        self._has_reported_delay = False

    def describe(self) -> Mapping[str, Description]:
        """Return the controller's joints in its own order, and its effort limits."""
        command = Description(names=self._names, limits={"effort": self._limit})
        described = {self._command_port: command}
        if self._status_port is not None:
            described[self._status_port] = Description(names=self._names)
        return described

    def calls(self) -> Mapping[str, Method]:
        """Return the calls that read and set the gains; none of a law of one's own."""
        return self._steering.methods()

    def _gains(self, params: Params) -> Mapping[str, str]:
        """Return the gains of the law, with their units."""
        units = ACCELERATION_UNITS if params.law == "computed_torque" else TORQUE_UNITS
        return {key: units[key] for key in gains_of(params)}

    def _set_gains(self, params: Params) -> None:
        check_gains(self.config, params, self._robot)
        cast("Steered", self.law).set_gains(params)

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Map the joints of both inputs by name; raises WiringError for those that are missing."""
        ports = (self._state_port, self._reference_port)
        self._state_order, self._reference_order = joint_orders(
            self.config.name, inputs, ports, self._names
        )
        sensed = inputs[self._state_port]
        slides = {
            name
            for name, joint_type in zip(sensed.names, sensed.details.get("type", ()), strict=False)
            if joint_type == "prismatic"
        }
        self._units = {name: "N" if name in slides else "N·m" for name in self._names}

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the torques of this step and the tracking error."""
        self._read(step)
        position = self._position
        if self._motion is None or position is None or self._reference is None:
            return {}
        q, v = self._motion
        torque = self.law.torque(q, v, self._reference, self._dt)
        wanted = self._checked(torque, step.index)
        values = [min(max(t, -limit), limit) for t, limit in zip(wanted, self._limit, strict=True)]
        command = JointCommand(mode="torque", values=values)
        if self._status_port is None:
            return {self._command_port: command}
        error: list[float] = (self._reference.position - position).tolist()
        return {self._command_port: command, self._status_port: self._status(error, wanted, values)}

    def save(self) -> bytes | None:
        """Return gains, filters and integral; None with a law of one's own, which has no such."""
        if type(self.law) not in LAWS.values():
            return None
        saved = Saved(
            params=self._steering.save(),
            integral=cast("Steered", self.law).integral.tolist(),
            estimator=self._estimator.save() if self._estimator is not None else [],
            smoothers=[item.save() for item in self._filters()],
            motion=None if self._motion is None else [part.tolist() for part in self._motion],
            position=_listed(self._position),
            reference=None
            if self._reference is None
            else [part.tolist() for part in self._reference],
            saturated=self._saturated,
            has_reported_delay=self._has_reported_delay,
        )
        return msgspec.msgpack.encode(saved)

    def restore(self, state: bytes) -> None:
        """Take what `save` returned."""
        saved = msgspec.msgpack.decode(state, type=Saved)
        law = cast("Steered", self.law)
        law.set_gains(self._steering.restore(saved.params))
        law.integral = np.array(saved.integral)
        if self._estimator is not None:
            self._estimator.restore(saved.estimator)
        for item, values in zip(self._filters(), saved.smoothers, strict=True):
            item.restore(values)
        if saved.motion is not None:
            self._motion = np.array(saved.motion[0]), np.array(saved.motion[1])
        self._position = None if saved.position is None else np.array(saved.position)
        if saved.reference is not None:
            self._reference = Reference(*map(np.array, saved.reference))
        self._saturated = saved.saturated
        self._has_reported_delay = saved.has_reported_delay

    def _filters(self) -> list[Smoother]:
        return [item for item in (self._smoother, self._velocity_smoother) if item is not None]

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that shape the torques."""
        return {"numpy": np.__version__, "pinocchio": installed_version("pin")}

    def _read(self, step: Step) -> None:
        """Read what is new on both inputs; the rest is held."""
        if step.is_new(self._state_port):
            state = step.read(self._state_port, JointState)
            self._motion = self._sense(state, self._measured_at_ns(step))
        if step.is_new(self._reference_port):
            reference = step.read(self._reference_port, JointReference)
            pick = self._reference_order.pick
            self._reference = Reference(
                pick(reference.position, "position"),
                pick(reference.velocity, "velocity"),
                pick(reference.acceleration, "acceleration"),
            )

    def _measured_at_ns(self, step: Step) -> int:
        """Return when the source of the newest joint state fired for it [ns]."""
        source = self.config.inputs[self._state_port]
        return due_step(step.index, source.delay, source.every) * self.config.step_ns

    def _sense(self, state: JointState, t_ns: int) -> tuple[Vector, Vector]:
        q = self._position = self._state_order.pick(state.position, "position")
        if self._smoother is not None:
            q = self._smoother.update(q)
        if self._estimator is not None:
            return q, self._estimator.update(q, t_ns)
        if state.velocity is None:
            raise RunError(
                f"{self.config.name}: input {self._state_port!r} carries no velocity; set params."
                "velocity to finite_difference or filtered, or let the plant sense it"
            )
        v = self._state_order.pick(state.velocity, "velocity")
        if self._velocity_smoother is not None:
            # By the same delay as the positions.
            v = self._velocity_smoother.update(v)
        return q, v

    def _checked(self, torque: Any, step: int) -> list[float]:
        """Return the law's torques as a list; raises RunError for a wrong shape or value."""
        vector = np.asarray(torque, dtype=np.float64)
        if vector.shape != (len(self._limit),):
            raise RunError(
                f"{self.config.name}: step {step}: the law returned torques of shape "
                f"{vector.shape}, not ({len(self._limit)},)"
            )
        values: list[float] = vector.tolist()
        if not all(map(math.isfinite, values)):
            rows = dict(zip(self._names, values, strict=True))
            raise RunError(
                f"{self.config.name}: step {step}: the torques are {rows}; is a gain too high, "
                "or an input not finite?"
            )
        return values

    def _status(
        self, error: list[float], wanted: list[float], values: list[float]
    ) -> ControllerStatus:
        """Return the status; a warning marks the step at which a joint starts to saturate."""
        warnings = [] if self._has_reported_delay else delay_warning(self._smoother)
        self._has_reported_delay = True
        saturated = [w != value for w, value in zip(wanted, values, strict=True)]
        if saturated != self._saturated:
            rows = zip(self._names, wanted, values, saturated, self._saturated, strict=True)
            warnings += [
                f"{name} saturates: {w:.1f} {self._units[name]} wanted, {value:.1f} commanded"
                for name, w, value, now, before in rows
                if now and not before
            ]
            self._saturated = saturated
        return ControllerStatus(error=error, saturated=saturated, warnings=warnings)


def _listed(vector: Vector | None) -> list[float] | None:
    values: list[float] | None = None if vector is None else vector.tolist()
    return values
