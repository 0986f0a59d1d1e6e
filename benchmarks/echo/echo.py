"""Participants that pass on messages of the size of two_link's and compute nothing."""

import random

import stepbus
from stepbus_participant import Config, Participant
from stepbus_schemas import Description, Image, JointCommand, JointReference, JointState, Message

PAIR = [0.25, 0.75]
_IMAGES = 8


def names(config: Config) -> list[str]:
    """Return the names of as many joints as the parameters ask for."""
    return [f"joint{number}" for number in range(1, config.params.get("joints", 2) + 1)]


class Plant(Participant):
    """Publishes a state first, and an image where it has a size; then takes the command.

    Images are noise, a few in turn: what sensors see does not compress as constant pixels do.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._values = PAIR[:1] * len(names(config))
        size = config.params.get("image", [])
        noise = random.Random(config.seed)
        self._images = [
            Image(
                width=size[0],
                height=size[1],
                encoding="rgb8",
                data=noise.randbytes(3 * size[0] * size[1]),
                focal=(300.0, 300.0),
                centre=(0.0, 0.0),
            )
            for _ in range(_IMAGES if size else 0)
        ]

    def describe(self) -> dict[str, Description]:
        return {"joint_state": Description(names=names(self.config))}

    def output(self, step: stepbus.Step) -> dict[str, Message]:
        values = self._values
        state = JointState(position=values, velocity=values, effort=values)
        if not self._images:
            return {"joint_state": state}
        return {"joint_state": state, "image": self._images[step.index % _IMAGES]}

    def update(self, step: stepbus.Step) -> None:
        step.read("command")


class Controller(Participant):
    """Answers what it reads with a command."""

    def describe(self) -> dict[str, Description]:
        return {"command": Description(like="joint_state")}

    def update(self, step: stepbus.Step) -> dict[str, JointCommand]:
        for port in self.config.inputs:
            step.read(port)
        values = step.read("joint_state", JointState).position or []
        return {"command": JointCommand(mode="torque", values=values)}


class Relay(Participant):
    """Passes a state on."""

    def describe(self) -> dict[str, Description]:
        return {"joint_state": Description(like="joint_state")}

    def update(self, step: stepbus.Step) -> dict[str, JointState]:
        return {"joint_state": step.read("joint_state", JointState)}


class Mission(Participant):
    """Publishes references, as far ahead as the window lets it."""

    def describe(self) -> dict[str, Description]:
        return {"reference": Description(names=names(self.config))}

    def update(self, step: stepbus.Step) -> dict[str, JointReference]:
        values = PAIR[:1] * len(names(self.config))
        return {"reference": JointReference(position=values, velocity=values, acceleration=values)}
