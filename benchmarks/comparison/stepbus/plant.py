# mypy: ignore-errors
"""The arm as a participant of stepbus."""

import arm

import stepbus
from stepbus import Description, JointCommand, JointState


class Plant(stepbus.Participant):
    """Publishes its state first, then reads the command of the same step."""

    def __init__(self, config: stepbus.Config) -> None:
        super().__init__(config)
        self.arm = arm.Arm()

    def describe(self) -> dict[str, Description]:
        return {"joint_state": Description(names=list(arm.JOINTS))}

    def output(self, step: stepbus.Step) -> dict[str, JointState]:
        state = JointState(position=list(self.arm.position), velocity=list(self.arm.velocity))
        return {"joint_state": state}

    def update(self, step: stepbus.Step) -> None:
        first, second = step.read("command", JointCommand).values
        self.arm.advance((first, second))
