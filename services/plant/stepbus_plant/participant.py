"""The plant as a participant; the scenario has it publish first."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version

from stepbus.config import Config
from stepbus.participant import Participant
from stepbus.step import Step
from stepbus_schemas import Description, JointCommand, Message, WiringError

from .commander import Commander
from .params import read_params
from .plant import Plant
from .world import load_world


class PlantParticipant(Participant):
    """Publishes the joints' state on each output and carries out the commands of each input.

    Needs `publishes: first`. Each input moves the joints that its description names; an input
    whose description names none moves all, in the plant's order. Before the first command of an
    input the motors of its joints are off.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        _refuse_ports(config)
        params = read_params(config.name, config.params)
        self._plant = Plant(
            load_world(config.path(params.world)),
            step_ns=config.step_ns * config.every,
            seed=config.seed,
            joints=params.joints,
            actuation=params.actuation,
            sense=params.sense,
            noise=params.noise,
            resolution=params.resolution,
        )
        self._commanders: list[tuple[str, Commander]] = []

    def describe(self) -> Mapping[str, Description]:
        """Return names, limits, types and modes of the joints, for each output."""
        return dict.fromkeys(self.config.outputs, self._plant.describe())

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Find the joints of each command input; raises WiringError when one cannot be moved."""
        for port in self.config.inputs:
            names = inputs[port].names if port in inputs else []
            self._commanders.append((port, self._plant.commander(names, port=port)))

    def output(self, step: Step) -> Mapping[str, Message]:
        """Return what the sensors read now, on every output."""
        return dict.fromkeys(self.config.outputs, self._plant.sense())

    def update(self, step: Step) -> None:
        """Take the newest commands and advance by one step."""
        for port, commander in self._commanders:
            command = step.get(port, JointCommand)
            if command is not None:
                commander.apply(command, step.index)
        self._plant.advance()

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that shape the result."""
        return {name: version(name) for name in ("numpy", "pybullet")}

    def close(self) -> None:
        """Give the physics engine back."""
        self._plant.close()


def _refuse_ports(config: Config) -> None:
    """Raise WiringError that lists every port of a type the plant does not speak."""
    problems = [
        f"participants.{config.name}.{side}.{port}: the plant {verb} {known}, not {row.type}"
        for side, verb, known, rows in (
            ("inputs", "takes", "JointCommand/1", config.inputs),
            ("outputs", "publishes", "JointState/1", config.outputs),
        )
        for port, row in rows.items()
        if row.type != known
    ]
    if problems:
        raise WiringError("\n".join(problems))
