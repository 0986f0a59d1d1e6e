"""The plant as a participant: ports on one side, the world on the other."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version

from stepbus.config import Config
from stepbus.participant import Participant
from stepbus.step import Step
from stepbus_schemas import Description, JointCommand, JointState, Message, WiringError

from .commander import Commander
from .params import read_params
from .plant import Plant
from .world import load_world


class PlantParticipant(Participant):
    """Publishes a JointState on each of its outputs, and obeys a JointCommand on each input.

    The scenario gives it `publishes: first`. A joint that was never commanded swings freely in
    mode torque, and holds its place in modes velocity and position.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        problems = self._port_problems()
        try:
            params = read_params(config.name, config.params)
            world = load_world(config.path(params.world))
        except WiringError as exc:
            raise WiringError("\n".join([*problems, str(exc)])) from exc
        if problems:
            raise WiringError("\n".join(problems))
        self.plant = Plant(world, params, config.step_ns * config.every, config.seed)
        self._commanders: dict[str, Commander] = {}

    def _port_problems(self) -> list[str]:
        ports = [
            *(("inputs", n, p.type, "JointCommand/1") for n, p in self.config.inputs.items()),
            *(("outputs", n, p.type, "JointState/1") for n, p in self.config.outputs.items()),
        ]
        return [
            f"participants.{self.config.name}.{kind}.{name}: a plant's {kind} are {wanted}, the "
            f"scenario has {given}"
            for kind, name, given, wanted in ports
            if given != wanted
        ]

    def describe(self) -> Mapping[str, Description]:
        """Return names, limits, types and modes of the joints, for every output."""
        return dict.fromkeys(self.config.outputs, self.plant.describe())

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Map the joints of every command by name."""
        for port, description in inputs.items():
            # A sender that names no joints speaks of all, in our order.
            names = description.names or self.plant.names
            self._commanders[port] = self.plant.commander(port, names)

    def output(self, step: Step) -> Mapping[str, Message]:
        """Return what the sensors show, on every output."""
        state: JointState = self.plant.sense()
        return dict.fromkeys(self.config.outputs, state)

    def update(self, step: Step) -> None:
        """Obey the new commands and advance the world by one step."""
        for port, commander in self._commanders.items():
            if step.is_new(port):
                commander.apply(step.read(port, JointCommand))
        self.plant.advance()

    def versions(self) -> Mapping[str, str]:
        """Return the versions of what the physics depend on."""
        return {name: version(name) for name in ("numpy", "pybullet", "stepbus")}

    def close(self) -> None:
        """Leave the physics engine."""
        self.plant.close()
