"""Participants that pass on messages of the size of two_link's and compute nothing."""

import sys

import stepbus
from stepbus_participant import Participant
from stepbus_schemas import Description, JointCommand, JointReference, JointState

PAIR = [0.25, 0.75]


class Plant(Participant):
    """Publishes a state first, then takes the command."""

    def describe(self) -> dict[str, Description]:
        return {"joint_state": Description(names=["joint1", "joint2"])}

    def output(self, step: stepbus.Step) -> dict[str, JointState]:
        return {"joint_state": JointState(position=PAIR, velocity=PAIR, effort=PAIR)}

    def update(self, step: stepbus.Step) -> None:
        step.read("command")


class Controller(Participant):
    """Answers a state and a reference with a command."""

    def update(self, step: stepbus.Step) -> dict[str, JointCommand]:
        step.read("joint_state")
        step.read("reference")
        return {"command": JointCommand(mode="torque", values=PAIR)}


class Mission(Participant):
    """Publishes references, as far ahead as the window lets it."""

    def describe(self) -> dict[str, Description]:
        return {"reference": Description(names=["joint1", "joint2"])}

    def update(self, step: stepbus.Step) -> dict[str, JointReference]:
        return {"reference": JointReference(position=PAIR, velocity=PAIR, acceleration=PAIR)}


ROLES = {"plant": Plant, "controller": Controller, "mission": Mission}

if __name__ == "__main__":
    raise SystemExit(stepbus.main(ROLES[sys.argv[1]]))
