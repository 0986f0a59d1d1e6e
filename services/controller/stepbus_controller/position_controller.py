"""Targets for joints with position motors of their own."""

from collections.abc import Mapping

import numpy as np

from stepbus_controller.position import Params
from stepbus_kinematics import Vector, joint_orders
from stepbus_participant import Config, Participant, Ports, Step
from stepbus_schemas import (
    ControllerStatus,
    Description,
    JointCommand,
    JointReference,
    JointState,
    Message,
    due_step,
)


class PositionController(Participant):
    """Turns a reference into position targets with a feed-forward velocity.

    Inputs: one JointReference/1 and one JointState/1. Outputs: one JointCommand/1 and, optionally,
    one ControllerStatus/1. A reference that is older than the step is extrapolated with its
    derivatives. The velocity leads from each target to the next in exactly one period. Parameters:
    see `Params`.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        ports = Ports(config)
        self._reference_port = ports.input_of("JointReference/1")
        self._state_port = ports.input_of("JointState/1")
        self._command_port = ports.output_of("JointCommand/1")
        self._status_port = ports.optional_output_of("ControllerStatus/1")
        ports.outputs_are("JointCommand/1", "ControllerStatus/1")
        params = config.read(Params, ports.problems)
        self._names = [params.prefix + joint for joint in params.joints]
        self._feeds_forward = params.feed_forward
        limit = params.effort_limit
        self._effort_limit = None if limit is None else limit.of(params.joints)
        self._period = config.every * config.step_ns * 1e-9

    def describe(self) -> Mapping[str, Description]:
        """Return the joints in the order of the commands."""
        ports = filter(None, (self._command_port, self._status_port))
        return {port: Description(names=self._names) for port in ports}

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Map the joints of both inputs by name; raises WiringError for those that are missing."""
        ports = (self._reference_port, self._state_port)
        self._reference_order, self._state_order = joint_orders(
            self.config.name, inputs, ports, self._names
        )

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the targets of this step, and the tracking error."""
        reference = step.get(self._reference_port, JointReference)
        if reference is None:
            return {}
        source = self.config.inputs[self._reference_port]
        late = step.index - due_step(step.index, source.delay, source.every)
        target, velocity = self._target(reference, late * self.config.step_ns * 1e-9)
        messages: dict[str, Message] = {
            self._command_port: JointCommand(
                mode="position",
                values=target.tolist(),
                velocity=velocity.tolist() if self._feeds_forward else None,
                effort_limit=self._effort_limit,
            )
        }
        state = step.get(self._state_port, JointState)
        if self._status_port is not None and state is not None:
            q = self._state_order.pick(state.position, "position")
            status = ControllerStatus(error=(target - q).tolist(), saturated=[False] * len(q))
            messages[self._status_port] = status
        return messages

    def _target(self, reference: JointReference, age: float) -> tuple[Vector, Vector]:
        """Return the targets now, and the velocities that lead to the next ones.

        Both of shape (n,), [rad, rad/s]. age: of the reference [s].
        """
        pick = self._reference_order.pick
        q = pick(reference.position, "position")
        v = pick(reference.velocity, "velocity")
        a = pick(reference.acceleration, "acceleration")
        return q + (v + a * (age / 2)) * age, v + a * (age + self._period / 2)

    def save(self) -> bytes:
        """Return nothing: each command follows from the inputs of its step."""
        return b""

    def restore(self, state: bytes) -> None:
        """Take nothing."""

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that shape the targets."""
        return {"numpy": np.__version__}
