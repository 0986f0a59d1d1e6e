"""The plant as a participant: ports on one side, the world on the other."""

import logging
from collections.abc import Mapping, Sequence
from typing import Literal

import msgspec

from stepbus_participant import (
    CallError,
    Config,
    Method,
    Participant,
    Problems,
    Step,
    format_duration,
    installed_version,
)
from stepbus_plant import bullet as _bullet  # noqa: F401  (before all that imports PyBullet)
from stepbus_plant import camera
from stepbus_plant import device_registry as devices
from stepbus_plant import sensor_registry as sensors
from stepbus_plant.commander import Commander
from stepbus_plant.device import BaseDriver
from stepbus_plant.device_registry import Driver
from stepbus_plant.plant import SimulatedPlant
from stepbus_plant.script import WorldCalls
from stepbus_plant.world_file import load_world
from stepbus_schemas import (
    Description,
    Event,
    InputConfig,
    JointMode,
    JointState,
    Message,
    WiringError,
)

from .params import Params

_TYPES = {
    "inputs": ("JointCommand/1", *devices.INPUTS),
    "outputs": (
        *("JointState/1", "Event/1", "Poses/1", camera.IMAGE, camera.CLOUD),
        *(*devices.OUTPUTS, *sensors.SECTIONS),
    ),
}


class _Saved(msgspec.Struct):
    """plant: its own state. modes: port → mode of the last command. warnings, events: pending.

    is_stopped: by an emergency stop.
    """

    plant: bytes
    modes: dict[str, JointMode | None]
    warnings: list[str]
    events: list[str]
    is_stopped: bool = False


STOPPED = (Commander, BaseDriver)
"""What an emergency stop stops; a gripper keeps what it holds."""
_log = logging.getLogger("stepbus_plant")


class Plant(Participant):
    """Publishes a JointState on each of its outputs and executes a JointCommand from each input.

    Bases, grippers and sensors have ports of their own types, named after the device. Each
    output of type Poses/1 carries the true poses of the links in `params.poses`, or once, if it is
    called `planogram`, where they belong. Warnings about commands go to outputs of type Event/1, or
    to the log if there is none. Until its first command, a joint swings freely in mode torque and
    holds its position in modes velocity and position.

    With `publishes: first`, it publishes the state of a step, then reads the command of that step
    and advances. With `publishes: last`, it reads the command, advances to the step, and publishes
    the state there; a command with `delay: 1` leads to the same states.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        params = config.read(Params, self._port_problems())
        world = load_world(params.world, params.stock)
        self.plant = SimulatedPlant(world, params, config.step_ns * config.every, config.seed)
        self._drivers: dict[str, Driver] = {}
        outputs = config.outputs.items()
        self._state_ports = [name for name, port in outputs if port.type == "JointState/1"]
        self._event_ports = [name for name, port in outputs if port.type == "Event/1"]
        self._pose_ports = [name for name, port in outputs if port.type == "Poses/1"]
        self._warnings: list[str] = []
        self._events: list[str] = []
        self._is_stopped = False
        try:
            self._connect(params)
        except WiringError as exc:
            self.plant.close()
            raise WiringError(f"{config.name}: {exc}") from exc

    def _connect(self, params: Params) -> None:
        """Find what each output measures; raises WiringError that lists all mistakes."""
        plant, period_ns = self.plant, self.config.step_ns * self.config.every
        problems = Problems()
        points = {name: (point.link, point.position) for name, point in params.points.items()}
        poses = problems.attempt((), lambda: plant.pose_sensor(params.poses, points))
        poses_period = problems.attempt((), lambda: _period(params.poses_period_ns, period_ns))
        views = problems.attempt(
            (), lambda: plant.cameras.views(self._outputs(camera.IMAGE, camera.CLOUD))
        )
        made = problems.attempt((), lambda: plant.devices.sensors(self._outputs(*devices.OUTPUTS)))
        readings = problems.attempt(
            (), lambda: plant.sensors.ports(self._outputs(*sensors.SECTIONS))
        )
        if poses is None or poses_period is None or views is None:
            raise problems.error()
        if made is None or readings is None:
            raise problems.error()
        self._poses, self._poses_period, self._views = poses, poses_period, views
        self._devices, self._sensors = made, readings
        self._has_views = bool(views.describe())
        self._links = plant.describe_poses(poses) if self._pose_ports else None
        self._planogram = plant.planogram(poses)

    def _outputs(self, *types: str) -> dict[str, str]:
        """Return the outputs of some types, each with its type."""
        outputs = self.config.outputs.items()
        return {name: port.type for name, port in outputs if port.type in types}

    def _port_problems(self) -> Problems:
        problems = self.config.problems()
        for side, ports in (("inputs", self.config.inputs), ("outputs", self.config.outputs)):
            for name, port in ports.items():
                if port.type not in _TYPES[side]:
                    types = " or ".join(_TYPES[side])
                    text = f"a plant's {side} have type {types}, not {port.type}"
                    problems.add((side, name), text)
        return problems

    def describe(self) -> Mapping[str, Description]:
        """Return what the vectors of each output belong to, with their constant properties."""
        return {
            **dict.fromkeys(self._state_ports, self.plant.describe()),
            **dict.fromkeys(self._event_ports, Description()),
            **dict.fromkeys(self._pose_ports, self._links or Description()),
            **{port: device.describe() for port, device in self._devices.items()},
            **self._views.describe(),
            **{port: sensor.describe() for port, (sensor, _) in self._sensors.items()},
        }

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Map joint commands by joint name, and find the device of every other command."""
        for port, description in inputs.items():
            config = self.config.inputs[port]
            if config.type in devices.INPUTS:
                self._drivers[port] = self._driver(port, config)
                continue
            # A sender that names no joints commands all of them, in the plant's order.
            names = description.names or self.plant.names
            if not description.names and len(names) > 1:
                text = f"names no joints; its values are applied to {', '.join(names)}"
                self.plant.warnings.add(f"input {port!r}", "names", text)
            period_ns = config.every * self.config.step_ns
            self._drivers[port] = self.plant.commander(port, names, period_ns)

    def _driver(self, port: str, config: InputConfig) -> Driver:
        plant = self.plant
        return plant.devices.driver(
            port, config.type, lambda names: plant.commander(port, names), plant.warnings
        )

    def output(self, step: Step) -> Mapping[str, Message]:
        """Return the sensor readings and new events."""
        state: JointState = self.plant.sense()
        messages: dict[str, Message] = dict.fromkeys(self._state_ports, state)
        if self._pose_ports and self.plant.t_ns % self._poses_period == 0:
            messages.update(dict.fromkeys(self._pose_ports, self._poses.sense()))
        if devices.PORT in self._pose_ports:
            messages.pop(devices.PORT, None)
            if self.plant.t_ns == 0:
                messages[devices.PORT] = self._planogram
        # A small arm has none of these, and a step of it is short.
        if self._devices:
            messages.update(self._sensed())
        if self._has_views:
            messages.update(self._views.images(self.plant.t_ns))
        if self._sensors:
            messages.update(self._readings(self.plant.t_ns))
        if self._warnings or self._events:
            messages.update(dict.fromkeys(self._event_ports, self._event()))
        return messages

    def _sensed(self) -> dict[str, Message]:
        """Return the readings of the devices; ports may share one, whose noise counts readings."""
        sensed = {
            key: device.sense()
            for key, device in {id(d): d for d in self._devices.values()}.items()
        }
        return {port: sensed[id(device)] for port, device in self._devices.items()}

    def _readings(self, t_ns: int) -> dict[str, Message]:
        """Return the readings of the sensors that are due; ports may share one."""
        due = {id(s): s for s, period_ns in self._sensors.values() if t_ns % period_ns == 0}
        readings = {key: sensor.sense(t_ns) for key, sensor in due.items()}
        return {
            port: readings[id(sensor)]
            for port, (sensor, _) in self._sensors.items()
            if id(sensor) in readings
        }

    def _event(self) -> Event:
        """Return what has happened since the last event, warnings first."""
        level: Literal["warning", "info"] = "warning" if self._warnings else "info"
        event = Event(level=level, text="\n".join(self._warnings + self._events))
        self._warnings, self._events = [], []
        return event

    def update(self, step: Step) -> Mapping[str, Message] | None:
        """Execute new commands and advance the world by one step; return its state if it is due."""
        is_last = self.config.publishes == "last"
        # The state of the first step is that before any command.
        advances = not is_last or step.index > 0
        for port, driver in self._drivers.items():
            if step.is_new(port) and not (self._is_stopped and isinstance(driver, STOPPED)):
                driver.apply(step.read(port))
            if advances:
                driver.before_step()
        warnings = [f"step {step.index}: {text}" for text in self.plant.warnings.take()]
        self._report(warnings, self._warnings, logging.WARNING)
        if advances:
            self.plant.advance()
            self._report(self.plant.script.take_events(), self._events, logging.INFO)
        return self.output(step) if is_last else None

    def save(self) -> bytes | None:
        """Return the state of the world and of the drivers; None where it cannot be had."""
        plant = self.plant.save()
        if plant is None:
            return None
        modes = {
            port: driver.mode
            for port, driver in self._drivers.items()
            if isinstance(driver, Commander)
        }
        return msgspec.msgpack.encode(
            _Saved(plant, modes, self._warnings, self._events, self._is_stopped)
        )

    def restore(self, state: bytes) -> None:
        """Take what `save` returned."""
        saved = msgspec.msgpack.decode(state, type=_Saved)
        self.plant.restore(saved.plant)
        for port, driver in self._drivers.items():
            if isinstance(driver, Commander):
                driver.mode = saved.modes[port]
        self._warnings, self._events = saved.warnings, saved.events
        self._is_stopped = saved.is_stopped

    def _report(self, new: Sequence[str], pending: list[str], level: int) -> None:
        """Queue messages for the next output, or log them if there is no Event port."""
        if self._event_ports:
            pending += new
            return
        for text in new:
            _log.log(level, text)

    def calls(self) -> Mapping[str, Method]:
        """Return the calls that query joints and bodies between two steps, or change them."""
        stop = Method(
            self.emergency_stop,
            "[ON]: brakes all joints and bases, whatever is commanded, until it is called with "
            "false; a gripper keeps what it holds",
            changes=True,
        )
        world = WorldCalls(self.plant.script, lambda: self.plant.t_ns)
        return {**self.plant.joint_calls().methods(), **world.methods(), "emergency_stop": stop}

    def emergency_stop(self, on: bool = True) -> None:
        """Brake all joints and bases, or let commands move them again."""
        if not isinstance(on, bool):
            raise CallError(f"{on!r} is neither true nor false")
        self._is_stopped = on
        if on:
            for driver in self._drivers.values():
                if isinstance(driver, STOPPED):
                    driver.stop()
        text = "emergency stop" if on else "emergency stop released"
        self._report([f"at {self.plant.t_ns / 1e9:.9g} s: {text}"], self._events, logging.INFO)

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that the physics depend on."""
        return {name: installed_version(name) for name in ("numpy", "pybullet", "stepbus")}

    def close(self) -> None:
        """Disconnect from the physics engine."""
        self.plant.close()


def _period(period_ns: int | None, step_ns: int) -> int:
    """Return the period of the poses [ns]; raises WiringError for one that steps do not meet."""
    if period_ns is None:
        return step_ns
    if period_ns % step_ns:
        period, step = format_duration(period_ns), format_duration(step_ns)
        raise WiringError(f"params.poses_period: {period} is not a multiple of the step ({step})")
    return period_ns
