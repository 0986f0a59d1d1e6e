"""The plant as a participant: ports on one side, the world on the other."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Literal

from stepbus_participant.calls import Verb
from stepbus_participant.config import Config
from stepbus_participant.durations import format_duration, parse_duration
from stepbus_participant.participant import Participant
from stepbus_participant.step import Step
from stepbus_schemas import Description, Event, InputConfig, JointState, Message, WiringError

from .devices import camera
from .devices import registry as devices
from .devices.registry import Driver
from .params import read_params
from .plant import Plant
from .world.file import load_world

_TYPES = {
    "inputs": ("JointCommand/1", *devices.INPUTS),
    "outputs": ("JointState/1", "Event/1", "Poses/1", camera.TYPE, *devices.OUTPUTS),
}
_log = logging.getLogger("stepbus_plant")


class PlantParticipant(Participant):
    """Publishes a JointState on each of its outputs, and obeys a JointCommand on each input.

    Bases, grippers and contact sensors of the world have ports of their own types, called like the
    device. On each output of type Poses/1 it publishes where the links of `params.poses` truly are.
    What commands ask for in vain it tells on outputs of type Event/1, or in its log without one.
    The scenario gives it `publishes: first`. A joint that was never commanded swings freely in
    mode torque, and holds its place in modes velocity and position.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        problems = self._port_problems()
        try:
            params = read_params(config.name, config.params)
            world = load_world(config.path(params.world), params.stock)
        except WiringError as exc:
            raise WiringError("\n".join([*problems, str(exc)])) from exc
        if problems:
            raise WiringError("\n".join(problems))
        self.plant = Plant(world, params, config.step_ns * config.every, config.seed)
        self._drivers: dict[str, Driver] = {}
        outputs = config.outputs.items()
        self._state_ports = [name for name, port in outputs if port.type == "JointState/1"]
        self._event_ports = [name for name, port in outputs if port.type == "Event/1"]
        self._pose_ports = [name for name, port in outputs if port.type == "Poses/1"]
        self._warnings: list[str] = []
        self._news: list[str] = []
        try:
            self._poses = self.plant.pose_sensor(params.poses)
            self._poses_period = _period(params.poses_period, config.step_ns * config.every)
            self._views = self.plant.cameras.views(
                name for name, port in outputs if port.type == camera.TYPE
            )
            self._links = self.plant.describe_poses(self._poses) if self._pose_ports else None
            self._devices = {
                name: self.plant.devices.sensor(name, port.type)
                for name, port in outputs
                if port.type in devices.OUTPUTS
            }
        except WiringError as exc:
            self.plant.close()
            raise WiringError(f"{config.name}: {exc}") from exc

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
        """Return who the vectors of each output belong to, and what never changes about them."""
        return {
            **dict.fromkeys(self._state_ports, self.plant.describe()),
            **dict.fromkeys(self._event_ports, Description()),
            **dict.fromkeys(self._pose_ports, self._links or Description()),
            **{port: device.describe() for port, device in self._devices.items()},
            **self._views.describe(),
        }

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Map the joints of every command by name, and find the device of every other one."""
        for port, description in inputs.items():
            config = self.config.inputs[port]
            if config.type in devices.INPUTS:
                self._drivers[port] = self._driver(port, config)
                continue
            # A sender that names no joints speaks of all, in our order.
            names = description.names or self.plant.names
            if not description.names and len(names) > 1:
                text = f"names no joints; its values are taken for {', '.join(names)}"
                self.plant.complaints.add(f"input {port!r}", "names", text)
            period_ns = config.every * self.config.step_ns
            self._drivers[port] = self.plant.commander(port, names, period_ns)

    def _driver(self, port: str, config: InputConfig) -> Driver:
        plant = self.plant
        return plant.devices.driver(
            port, config.type, lambda names: plant.commander(port, names), plant.complaints
        )

    def output(self, step: Step) -> Mapping[str, Message]:
        """Return what the sensors show, and the warnings that are new."""
        state: JointState = self.plant.sense()
        messages: dict[str, Message] = dict.fromkeys(self._state_ports, state)
        if self._pose_ports and self.plant.t_ns % self._poses_period == 0:
            messages.update(dict.fromkeys(self._pose_ports, self._poses.sense()))
        messages.update({port: device.sense() for port, device in self._devices.items()})
        messages.update(self._views.images(self.plant.t_ns))
        if self._warnings or self._news:
            messages.update(dict.fromkeys(self._event_ports, self._event()))
        return messages

    def _event(self) -> Event:
        """Return what has happened since the last one; warnings come first."""
        level: Literal["warning", "info"] = "warning" if self._warnings else "info"
        event = Event(level=level, text="\n".join(self._warnings + self._news))
        self._warnings, self._news = [], []
        return event

    def update(self, step: Step) -> None:
        """Obey the new commands and advance the world by one step."""
        for port, driver in self._drivers.items():
            if step.is_new(port):
                driver.apply(step.read(port))
            driver.before_step()
        complaints = [f"step {step.index}: {text}" for text in self.plant.complaints.take()]
        self._tell(complaints, self._warnings, logging.WARNING)
        self.plant.advance()
        self._tell(self.plant.script.take(), self._news, logging.INFO)

    def _tell(self, new: Sequence[str], kept: list[str], level: int) -> None:
        """Keep what is new for the next output; without a port for it, log it."""
        if self._event_ports:
            kept += new
            return
        for text in new:
            _log.log(level, text)

    def calls(self) -> Mapping[str, Verb]:
        """Return what can be asked about joints between two steps; one can be teleported, too."""
        return self.plant.questions().verbs()

    def versions(self) -> Mapping[str, str]:
        """Return the versions of what the physics depend on."""
        return {name: version(name) for name in ("numpy", "pybullet", "stepbus")}

    def close(self) -> None:
        """Leave the physics engine."""
        self.plant.close()


def _period(text: str | None, step_ns: int) -> int:
    """Return the period of the poses [ns]; raises WiringError for one that steps do not meet."""
    if text is None:
        return step_ns
    try:
        period = parse_duration(text)
    except WiringError as exc:
        raise WiringError(f"params.poses_period: {exc}") from exc
    if period <= 0 or period % step_ns:
        step = format_duration(step_ns)
        raise WiringError(f"params.poses_period: {text} is no multiple of the step of {step}")
    return period
