"""A PD controller: torque = kp · position error + kd · velocity error."""

from collections.abc import Mapping

import stepbus


class Controller(stepbus.Participant):
    inputs = {"joint_state": stepbus.SensedJoints, "reference": stepbus.JointReference}
    outputs = {"command": stepbus.JointCommand}

    def describe(self) -> dict[str, stepbus.Description]:
        return {"command": stepbus.Description(like="joint_state")}

    def start(self, inputs: Mapping[str, stepbus.Description]) -> None:
        # Index of each joint in the reference.
        names = inputs["reference"].names
        self.order = [names.index(joint) for joint in inputs["joint_state"].names]

    def update(self, step: stepbus.Step) -> dict[str, stepbus.JointCommand] | None:
        state = step.get("joint_state", stepbus.SensedJoints)
        wanted = step.get("reference", stepbus.JointReference)
        if state is None or wanted is None:
            return None  # an input has no message yet
        kp, kd = self.config.params["kp"], self.config.params["kd"]
        errors = [wanted.position[i] - q for i, q in zip(self.order, state.position)]
        rates = [wanted.velocity[i] - v for i, v in zip(self.order, state.velocity)]
        torque = [kp * error + kd * rate for error, rate in zip(errors, rates)]
        return {"command": stepbus.JointCommand(mode="torque", values=torque)}
