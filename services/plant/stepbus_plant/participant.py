"""The plant as a participant: ports on one side, the world on the other."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from importlib.metadata import version

from stepbus.calls import Verb
from stepbus.config import Config
from stepbus.participant import Participant
from stepbus.step import Step
from stepbus_schemas import Description, Event, JointCommand, JointState, Message, WiringError

from .commander import Commander
from .params import read_params
from .plant import Plant
from .poses import PoseSensor
from .world import load_world

_TYPES = {"inputs": ("JointCommand/1",), "outputs": ("JointState/1", "Event/1", "Poses/1")}
_log = logging.getLogger("stepbus_plant")


class PlantParticipant(Participant):
    """Publishes a JointState on each of its outputs, and obeys a JointCommand on each input.

    On each output of type Poses/1 it publishes where the links of `params.poses` truly are. What
    commands ask for in vain it tells on outputs of type Event/1, or in its log without one.
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
        outputs = config.outputs.items()
        self._state_ports = [name for name, port in outputs if port.type == "JointState/1"]
        self._event_ports = [name for name, port in outputs if port.type == "Event/1"]
        self._pose_ports = [name for name, port in outputs if port.type == "Poses/1"]
        self._poses = self._pose_sensor(params.poses)
        self._warnings: list[str] = []

    def _pose_sensor(self, links: list[str] | None) -> PoseSensor:
        try:
            return self.plant.pose_sensor(links)
        except WiringError as exc:
            self.plant.close()
            raise WiringError(f"{self.config.name}: {exc}") from exc

    def _port_problems(self) -> list[str]:
        ports = [
            *(("inputs", n, p.type) for n, p in self.config.inputs.items()),
            *(("outputs", n, p.type) for n, p in self.config.outputs.items()),
        ]
        return [
            f"participants.{self.config.name}.{kind}.{name}: a plant's {kind} are "
            f"{' and '.join(_TYPES[kind])}, the scenario has {given}"
            for kind, name, given in ports
            if given not in _TYPES[kind]
        ]

    def describe(self) -> Mapping[str, Description]:
        """Return names, limits, types and modes of the joints, for every joint state."""
        return {
            **dict.fromkeys(self._state_ports, self.plant.describe()),
            **dict.fromkeys(self._event_ports, Description()),
            **dict.fromkeys(self._pose_ports, Description(names=self._poses.names)),
        }

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Map the joints of every command by name."""
        for port, description in inputs.items():
            # A sender that names no joints speaks of all, in our order.
            names = description.names or self.plant.names
            if not description.names and len(names) > 1:
                text = f"names no joints; its values are taken for {', '.join(names)}"
                self.plant.complaints.add(f"input {port!r}", "names", text)
            period_ns = self.config.inputs[port].every * self.config.step_ns
            self._commanders[port] = self.plant.commander(port, names, period_ns)

    def output(self, step: Step) -> Mapping[str, Message]:
        """Return what the sensors show, and the warnings that are new."""
        state: JointState = self.plant.sense()
        messages: dict[str, Message] = dict.fromkeys(self._state_ports, state)
        if self._pose_ports:
            messages.update(dict.fromkeys(self._pose_ports, self._poses.sense()))
        if self._warnings and self._event_ports:
            event = Event(level="warning", text="\n".join(self._warnings))
            messages.update(dict.fromkeys(self._event_ports, event))
            self._warnings = []
        return messages

    def update(self, step: Step) -> None:
        """Obey the new commands and advance the world by one step."""
        for port, commander in self._commanders.items():
            if step.is_new(port):
                commander.apply(step.read(port, JointCommand))
        self._warn(step)
        self.plant.advance()

    def _warn(self, step: Step) -> None:
        """Keep new complaints for the next output; without a port for them, log them."""
        new = [f"step {step.index}: {text}" for text in self.plant.complaints.take()]
        if self._event_ports:
            self._warnings += new
        else:
            for text in new:
                _log.warning(text)

    def calls(self) -> Mapping[str, Verb]:
        """Return what can be asked about joints between two steps; one can be teleported, too."""
        return self.plant.questions().verbs()

    def versions(self) -> Mapping[str, str]:
        """Return the versions of what the physics depend on."""
        return {name: version(name) for name in ("numpy", "pybullet", "stepbus")}

    def close(self) -> None:
        """Leave the physics engine."""
        self.plant.close()
