"""The controller as a participant: reads the joints, applies the law, commands torques."""

import math
from collections.abc import Mapping, Sequence
from operator import le, ne, sub
from typing import Any, cast

import msgspec
import numpy as np

from stepbus_controller.laws import LAWS, PD, Reference, check_gains, make_law, make_robot
from stepbus_controller.params import Params
from stepbus_controller.smoothing import Differentiator, make_smoother
from stepbus_kinematics import Vector, joint_orders
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

_Three = tuple[Sequence[float], Sequence[float], Sequence[float]]


class _State(msgspec.Struct, forbid_unknown_fields=True):
    """The newest inputs and the last status of a controller; a value of each joint, in its order.

    motion: positions as measured at measured_ns, positions and velocities for the law. saturated:
    which joints.
    """

    motion: _Three | None = None
    measured_ns: int = 0
    reference: _Three | None = None
    saturated: list[bool] = []
    has_reported_delay: bool = False


class _Saved(msgspec.Struct, forbid_unknown_fields=True):
    """A controller at a checkpoint.

    params: including the gains that calls have set. integral: of the law. filters: their memory.
    """

    state: _State
    params: dict[str, Any]
    integral: list[float]
    filters: list[list[Vector]]


class Controller(Participant):
    """Commands joint torques by a control law, clipped at the effort limits.

    Inputs: one JointState/1 and one JointReference/1. Outputs: one JointCommand/1 and, optionally,
    one ControllerStatus/1. Ports can have any name. Publishes nothing until both inputs have a
    message. Calls read and set its gains. The status reports the delay of `smoothing` once.
    Parameters: see `Params`.
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
        sensed_s = max(config.every, config.inputs[self._state_port].every) * config.step_ns * 1e-9
        self._smoother = make_smoother(params, sensed_s)
        self._velocity_smoother = make_smoother(params, sensed_s)
        self._differentiator: Differentiator | None = None
        if params.velocity != "measured":
            self._differentiator = Differentiator(params.cutoff_hz)
        filters = (self._smoother, self._velocity_smoother, self._differentiator)
        self._filters = [item for item in filters if item is not None]
        self._robot = make_robot(config, params)
        self._names = [params.prefix + joint for joint in self._robot.joints]
        self.law = make_law(config, params, self._robot)
        self._is_own, self._pd = type(self.law) not in LAWS.values(), cast("PD", self.law)
        gains = LAWS[params.law].gains if params.law in LAWS else {}
        self._steering = Steering(config, Params, gains, self._set_gains)
        self._limit: list[float] = self._robot.effort_limit.tolist()
        self._dt = config.every * config.step_ns * 1e-9
        self._state = _State(saturated=[False] * len(self._limit))

    def describe(self) -> Mapping[str, Description]:
        """Return the controller's joints in its own order, and its effort limits."""
        command = Description(names=self._names, limits={"effort": self._limit})
        described = {self._command_port: command}
        if self._status_port is not None:
            described[self._status_port] = Description(names=self._names)
        return described

    def calls(self) -> Mapping[str, Method]:
        """Return the calls that get and set the gains; empty for a law of the user's own."""
        return self._steering.methods()

    def _set_gains(self, params: Params) -> None:
        check_gains(self.config, params, self._robot)
        self._pd.set_gains(params)

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Map the joints of both inputs by name; raises WiringError for missing joints."""
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
        motion, reference = self._state.motion, self._state.reference
        if motion is None or reference is None:
            return {}
        position, q, v = motion
        if self._is_own:
            wanted = self._own_torques(q, v, reference, step.index)
        else:
            wanted = self._pd.efforts(q, v, reference, self._dt)
        is_within = all(map(le, map(abs, wanted), self._limit))
        values = wanted if is_within else self._clipped(wanted, step.index)
        command = JointCommand(mode="torque", values=values)
        if self._status_port is None:
            return {self._command_port: command}
        error = list(map(sub, reference[0], position))
        return {self._command_port: command, self._status_port: self._status(error, wanted, values)}

    def _clipped(self, wanted: list[float], step: int) -> list[float]:
        """Return torques within the limits; raises RunError where they are not finite."""
        if not all(map(math.isfinite, wanted)):
            raise RunError(
                f"{self.config.name}: step {step}: the torques are "
                f"{dict(zip(self._names, wanted, strict=True))}; is a gain too high, or an input "
                "not finite?"
            )
        rows = zip(wanted, self._limit, strict=True)
        return [t if -most <= t <= most else math.copysign(most, t) for t, most in rows]

    def save(self) -> bytes | None:
        """Return inputs, gains, filters and integral; None for a law of the user's own."""
        if self._is_own:
            return None
        filters = [item.memory for item in self._filters]
        saved = _Saved(self._state, self._steering.save(), self._pd.integral, filters)
        return msgspec.msgpack.encode(saved, enc_hook=np.ndarray.tolist)

    def restore(self, state: bytes) -> None:
        """Restore inputs, gains, filters and integral from `save`."""
        saved = msgspec.msgpack.decode(state, type=_Saved, dec_hook=lambda _, row: np.array(row))
        self._state = saved.state
        self._pd.set_gains(self._steering.restore(saved.params))
        self._pd.integral = saved.integral
        for item, memory in zip(self._filters, saved.filters, strict=True):
            item.memory = memory

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that shape the torques."""
        return {"numpy": np.__version__, "pinocchio": installed_version("pin")}

    def _read(self, step: Step) -> None:
        """Read new messages of both inputs; an input without a new message holds the last."""
        if step.is_new(self._state_port):
            self._state.motion = self._sense(step.read(self._state_port, JointState), step.index)
        if step.is_new(self._reference_port):
            reference = step.read(self._reference_port, JointReference)
            ordered = self._reference_order.ordered
            self._state.reference = (
                ordered(reference.position, "position"),
                ordered(reference.velocity, "velocity"),
                ordered(reference.acceleration, "acceleration"),
            )

    def _sense(self, state: JointState, step: int) -> _Three:
        position = q = self._state_order.ordered(state.position, "position")
        if self._smoother is not None:
            q = self._smoother.update(np.array(q)).tolist()
        if self._differentiator is not None:
            source = self.config.inputs[self._state_port]
            t_ns = due_step(step, source.delay, source.every) * self.config.step_ns
            since_ns, self._state.measured_ns = t_ns - self._state.measured_ns, t_ns
            return position, q, self._differentiator.update(np.array(q), since_ns).tolist()
        if state.velocity is None:
            raise RunError(
                f"{self.config.name}: input {self._state_port!r} carries no velocity; set params."
                "velocity to finite_difference or filtered, or add velocity to the plant's 'sense'"
            )
        v = self._state_order.ordered(state.velocity, "velocity")
        if self._velocity_smoother is not None:
            # By the same delay as the positions.
            v = self._velocity_smoother.update(np.array(v)).tolist()
        return position, q, v

    def _own_torques(self, q: Any, v: Any, reference: _Three, step: int) -> list[float]:
        """Return the torques of a law of the user's own; raises RunError for a wrong shape."""
        arrays = Reference(*map(np.array, reference))
        torque = self.law.torque(np.array(q), np.array(v), arrays, self._dt)
        vector = np.asarray(torque, dtype=np.float64)
        if vector.shape != (len(self._limit),):
            raise RunError(
                f"{self.config.name}: step {step}: the control law returned torques of shape "
                f"{vector.shape}, expected ({len(self._limit)},)"
            )
        return cast("list[float]", vector.tolist())

    def _status(
        self, error: list[float], wanted: list[float], values: list[float]
    ) -> ControllerStatus:
        """Return the status; a warning marks the step at which a joint starts to saturate."""
        memory = self._state
        warnings = []
        if not memory.has_reported_delay:
            warnings = list(self._robot.notes)
            if self._smoother is not None:
                delay_ms = self._smoother.delay * 1e3
                warnings.insert(0, f"smoothing delays the measurements by {delay_ms:.1f} ms")
        memory.has_reported_delay = True
        saturated = list(map(ne, wanted, values))
        if saturated != memory.saturated:
            rows = zip(self._names, wanted, values, saturated, memory.saturated, strict=True)
            warnings += [
                f"{name} saturates: {w:.1f} {self._units[name]} wanted, {value:.1f} commanded"
                for name, w, value, now, before in rows
                if now and not before
            ]
            memory.saturated = saturated
        return ControllerStatus(error=error, saturated=saturated, warnings=warnings)
