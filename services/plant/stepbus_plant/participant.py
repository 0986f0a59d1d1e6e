"""The plant as a participant: connects the world to ports."""

import logging
from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar, Literal

import msgspec

from stepbus_participant import (
    CallError,
    Config,
    Method,
    Participant,
    Problems,
    Step,
    installed_version,
    suggest,
    warn,
)
from stepbus_plant.camera import TYPES
from stepbus_plant.commander import Commander
from stepbus_plant.devices import COMMANDS, STATES, period_problem
from stepbus_plant.engine import PhysicsError
from stepbus_plant.params import Params
from stepbus_plant.plant import SimulatedPlant
from stepbus_plant.poses import PLANOGRAM, Planogram, PoseSensor
from stepbus_plant.push import PUSH
from stepbus_plant.world_file import World, load_world
from stepbus_schemas import Description, Event, Message, WiringError

_STOP = "EmergencyStop/1"
_TYPES = {
    "inputs": ("JointCommand/1", *COMMANDS, PUSH),
    "outputs": (
        "JointState/1",
        "Event/1",
        "Poses/1",
        *dict.fromkeys(TYPES.values()),
        *STATES,
        _STOP,
    ),
}
_log = logging.getLogger("stepbus_plant")


class Plant(Participant):
    """Publishes a JointState on each of its outputs and executes a JointCommand from each input.

    Bases, grippers and sensors have ports of their own types, named after the device. Each output
    of type Poses/1 carries the true poses of the links in `params.poses`; one called `planogram`
    carries their nominal poses, once. Warnings about commands go to outputs of type Event/1, or to
    the log without one. Until its first command, a joint swings freely in mode torque and holds
    its position in modes velocity and position.

    With `publishes: first`, it publishes the state of a step, then reads the command of that step
    and advances. With `publishes: last`, it reads the command, advances to the step, and publishes
    the state there; a command with `delay: 1` leads to the same states.
    """

    settings: ClassVar[type[Params]] = Params
    """Of its parameters."""

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        problems = config.problems()
        for side, ports in (("inputs", config.inputs), ("outputs", config.outputs)):
            for name, port in ports.items():
                if port.type not in _TYPES[side]:
                    types = " or ".join(_TYPES[side])
                    text = f"{side} of a plant have type {types}, not {port.type}"
                    problems.add((side, name), text)
        params = config.read(self.settings, problems)
        world = self.load(params, problems)
        self._period_ns = config.step_ns * config.every
        self.plant = SimulatedPlant(world, params, self._period_ns, config.seed, problems)
        for subject, text in self.plant.physics.notes:
            warn(f"{subject}: {text}")
        self._drivers = self.plant.stop.drivers
        self._is_last = config.publishes == "last"
        self._event_ports = [n for n, port in config.outputs.items() if port.type == "Event/1"]
        self._reasons: list[str] = []
        self._warnings: list[str] = []
        self._events: list[str] = []
        try:
            self._connect(params, problems)
        except WiringError:
            self.plant.close()
            raise

    def load(self, params: Any, problems: Problems) -> World:
        """Return the world that the parameters name; problems: of this participant so far."""
        wrong = problems.below(("params", "stock"))
        return load_world(params.world, params.stock, wrong, seed=self.config.seed)

    def _connect(self, params: Params, problems: Problems) -> None:
        """Find what each output shows, and the device of every command but those of joints.

        Raises SettingsError that lists all mistakes.
        """
        plant, period_ns = self.plant, self._period_ns
        types = {port: config.type for port, config in self.config.outputs.items()}
        drivers = {
            port: problems.attempt(("inputs", port), partial(plant.driver, port, config.type))
            for port, config in self.config.inputs.items()
            if config.type in _TYPES["inputs"][1:]
        }
        devices = {
            port: problems.attempt(("outputs", port), partial(plant.devices.sensor, port, name))
            for port, name in types.items()
            if name in (*TYPES.values(), *STATES)
        }
        wrong = problems.below(("params",))
        pushing = [port for port, row in self.config.inputs.items() if row.type == PUSH]
        for port in params.pushes:
            if port not in pushing:
                text = f"is no input of type {PUSH}{suggest(port, pushing)}"
                wrong.add(("pushes", port), text)
        if text := period_problem(params.poses_period_ns, period_ns):
            wrong.add(("poses_period",), text)
        poses = problems.attempt(
            (), lambda: PoseSensor(plant.physics, params.poses, params.points, wrong)
        )
        if poses is None or len(problems):
            raise problems.error()
        self._devices = {port: row for port, row in drivers.items() if row is not None}
        sensors = {port: row for port, row in devices.items() if row is not None}
        for port, name in types.items():
            if name == "JointState/1":
                sensors[port] = plant.joints, period_ns
            elif name == _STOP:
                sensors[port] = plant.stop, period_ns
            elif name == "Poses/1":
                sensors[port] = poses, params.poses_period_ns or period_ns
                if port == PLANOGRAM:
                    sensors[port] = Planogram(poses, plant.world.items), period_ns
        self._descriptions = {port: sensor.description for port, (sensor, _) in sensors.items()}
        # Ports may share a sensor, whose noise counts readings.
        self._readings = [
            (*row, [port for port, other in sensors.items() if other[0] is row[0]])
            for row in {id(row[0]): row for row in sensors.values()}.values()
        ]

    def describe(self) -> Mapping[str, Description]:
        """Return the names and constant properties of each output's vectors."""
        return {**dict.fromkeys(self._event_ports, Description()), **self._descriptions}

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Map joint commands by joint name.

        Raises SettingsError that lists all mistakes.
        """
        problems = self.config.problems()
        for port, description in inputs.items():
            driver = problems.attempt(("inputs", port), partial(self._driver, port, description))
            if driver is not None:
                self._drivers[port] = driver
        problems.refuse()

    def _driver(self, port: str, description: Description) -> Commander:
        config = self.config.inputs[port]
        if port in self._devices:
            return self._devices[port]
        # A sender that names no joints commands all of them, in the plant's order.
        names = description.names or self.plant.names
        if not description.names and len(names) > 1:
            text = f"names no joints; its values are applied to {', '.join(names)}"
            self.plant.warnings.add(f"input {port!r}", "names", text)
        return self.plant.commander(port, names, config.every * self.config.step_ns)

    def output(self, step: Step) -> Mapping[str, Message]:
        """Return the sensor readings and new events."""
        t_ns = self.plant.t_ns
        messages: dict[str, Message] = {}
        for sensor, period_ns, ports in self._readings:
            if t_ns % period_ns == 0 and (message := sensor.sense(t_ns)) is not None:
                for port in ports:
                    messages[port] = message
        if self._warnings or self._events:
            # Warnings first.
            level: Literal["warning", "info"] = "warning" if self._warnings else "info"
            event = Event(level=level, text="\n".join(self._warnings + self._events))
            self._warnings, self._events = [], []
            messages |= dict.fromkeys(self._event_ports, event)
        return messages

    def update(self, step: Step) -> Mapping[str, Message] | None:
        """Execute new commands and advance the world by one step; return its state if it is due."""
        is_last, plant = self._is_last, self.plant
        # The state of the first step is that before any command.
        advances, is_stopped = not is_last or step.index > 0, plant.stop.state.active
        for port, driver in self._drivers.items():
            if step.is_new(port) and not (is_stopped and driver.obeys_stop):
                driver.apply(step.read(port))
                driver.state.heard_ns = plant.t_ns
        if advances:
            longest_ns = plant.params.watchdog_ns
            if longest_ns is not None and not is_stopped:
                plant.stop.watch(plant.t_ns, longest_ns, plant.script.record)
            for driver in self._drivers.values():
                driver.before_step()
        if plant.warnings.pending:
            warnings = [f"step {step.index}: {text}" for text in plant.warnings.pending]
            plant.warnings.pending.clear()
            self._report(warnings, self._warnings, logging.WARNING)
        if advances:
            plant.advance()
            if plant.script.events:
                self._report(plant.script.events, self._events, logging.INFO)
        return self.output(step) if is_last else None

    def _report(self, new: list[str], pending: list[str], level: int) -> None:
        """Move messages to the next output, or to the log if there is no Event port."""
        if self._event_ports:
            pending += new
        else:
            for text in new:
                _log.log(level, text)
        new.clear()

    def save(self) -> bytes | None:
        """Return the state of the world and of the drivers; None if it cannot be saved."""
        why = self.plant.unsaved()
        if not why:
            try:
                state = self.plant.save()
                return msgspec.msgpack.encode((state, self._warnings, self._events))
            except (OSError, PhysicsError) as exc:
                # A run does not end for want of a checkpoint.
                why = str(exc)
        if why not in self._reasons:
            self._reasons.append(why)
            warn(f"no checkpoint at {self.plant.t_ns / 1e9:.9g} s: {why}")
        return None

    def restore(self, state: bytes) -> None:
        """Take a state from `save`."""
        plant, self._warnings, self._events = msgspec.msgpack.decode(state)
        self.plant.restore(plant)

    def calls(self) -> Mapping[str, Method]:
        """Return the calls that query joints and bodies between two steps, or change them."""
        stop = Method(
            self.emergency_stop,
            "[ON, BY]: brakes all joints and bases and ignores commands, until called with false; "
            "a gripper keeps what it holds; BY: who stops it, for the log",
            changes=True,
        )
        return {**self.plant.calls.methods(), "emergency_stop": stop}

    def emergency_stop(self, on: bool = True, by: str = "a call") -> None:
        """Brake all joints and bases, or let commands move them again; by: who asks."""
        if not isinstance(on, bool):
            raise CallError(f"ON must be true or false, not {on!r}")
        script = self.plant.script
        self.plant.stop.set(self.plant.t_ns, by, script.record, active=on)
        self._report(script.events, self._events, logging.INFO)

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that physics and images depend on."""
        engine = self.plant.physics.engine
        versions = {name: installed_version(name) for name in ("numpy", engine.name, "stepbus")}
        if self.plant.devices.has_images:
            versions["renderer"] = engine.renderer()
        return versions

    def close(self) -> None:
        """Disconnect from the physics engine."""
        self.plant.close()
