"""Two participants that need no extra: an integrator with one joint, and what drives it."""

from typing import ClassVar

from stepbus import Config, Description, JointCommand, JointState, Participant, Step


class Cart(Participant):
    """Moves its joint with the velocity that it is told."""

    inputs: ClassVar = {"command": JointCommand}
    outputs: ClassVar = {"joint_state": JointState}

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self.position = 0.0

    def describe(self) -> dict[str, Description]:
        """Name the joint."""
        return {"joint_state": Description(names=["slide"])}

    def output(self, step: Step) -> dict[str, JointState]:
        """Publish where the joint is [m]."""
        return {"joint_state": JointState(position=[self.position], velocity=[0.0])}

    def update(self, step: Step) -> None:
        """Move by one step."""
        command = step.read("command", JointCommand)
        self.position += 0.005 * command.values[0]


class Driver(Participant):
    """Pulls the joint to 1 m. Parameter `gain`: [1/s]."""

    inputs: ClassVar = {"joint_state": JointState}
    outputs: ClassVar = {"command": JointCommand}

    def describe(self) -> dict[str, Description]:
        """Command the joint of the state."""
        return {"command": Description(like="joint_state")}

    def update(self, step: Step) -> dict[str, JointCommand]:
        """Publish the velocity [m/s]."""
        position = step.read("joint_state", JointState).position or [0.0]
        gain = float(self.config.params["gain"])
        return {"command": JointCommand(mode="velocity", values=[gain * (1.0 - position[0])])}
