# mypy: ignore-errors
"""The PD controller as a participant of stepbus."""

import arm

import stepbus
from stepbus import Description, JointCommand, SensedJoints


class Controller(stepbus.Participant):
    """Answers each state with a torque."""

    def describe(self) -> dict[str, Description]:
        return {"command": Description(like="joint_state")}

    def update(self, step: stepbus.Step) -> dict[str, JointCommand]:
        state = step.read("joint_state", SensedJoints)
        q1, q2 = state.position
        v1, v2 = state.velocity
        torque = arm.control(step.index, (q1, q2), (v1, v2))
        return {"command": JointCommand(mode="torque", values=list(torque))}
