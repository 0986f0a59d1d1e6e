"""What a world has beside its bodies: bases, grippers, cameras and sensors, and their ports."""

from collections.abc import Iterator, Mapping
from typing import Any, Protocol

from stepbus_participant import format_duration, suggest
from stepbus_participant.parameters import Keys
from stepbus_plant.base import Base
from stepbus_plant.camera import TYPES, Camera, Lens, views
from stepbus_plant.commander import BaseDriver, Commander, GripperDriver, TriggerDriver
from stepbus_plant.contacts import ContactSensor
from stepbus_plant.drives import Motors
from stepbus_plant.gripper import Gripper
from stepbus_plant.memory import Remembers
from stepbus_plant.noise import Noise
from stepbus_plant.params import Params
from stepbus_plant.physics import Physics
from stepbus_plant.readings import ImuSensor, Lidar, TransformSensor, WrenchSensor
from stepbus_plant.world import WORLD, BaseSettings, GripperSettings
from stepbus_schemas import Description, Message, WiringError

TRIGGER = "CameraTrigger/1"
COMMANDS = {"BaseCommand/1": "bases", "GripperCommand/1": "grippers", TRIGGER: "cameras"}
"""Type of an input → section of the world file that declares its devices."""
STATES = {
    "BaseState/1": "bases",
    "Contacts/1": "contacts",
    "GripperState/1": "grippers",
    "Imu/1": "imus",
    "LaserScan/1": "lidars",
    "Transforms/1": "transforms",
    "Wrench/1": "wrenches",
}
"""Type of an output → likewise."""
_MADE_WHEN_NEEDED = {
    "imus": ImuSensor,
    "lidars": Lidar,
    "transforms": TransformSensor,
    "wrenches": WrenchSensor,
}
"""Section → class; what no port needs must not change the physics."""
_SENSORS = ("contacts", "cameras", *_MADE_WHEN_NEEDED)
SECTIONS = ("bases", "grippers", *_SENSORS)


class Sensor(Protocol):
    """What one or several outputs show."""

    @property
    def description(self) -> Description:
        """What it is on, or the joints or links it is of."""
        ...

    def sense(self, t_ns: int, /) -> Message | None:
        """Return its reading at a time [ns]; None: it has none now."""
        ...


class Devices(Remembers):
    """All devices and sensors of a world in which `mistakes` finds none.

    period_ns: length of the plant's step [ns]. params, seed: of their errors. felt: the sensors of
    contacts that outputs show. has_images: whether outputs show cameras.
    """

    parts = ("cameras", "_sensors")

    def __init__(self, physics: Physics, params: Params, period_ns: int, seed: int) -> None:
        world, joints, engine = physics.world, physics.joints, physics.engine
        self._physics, self._seed = physics, seed
        self._period_ns = period_ns
        self.bases = {
            name: Base(
                row,
                (joints[row.left], joints[row.right]),
                engine,
                params.odometry,
                Noise(seed, "odometry", name),
            )
            for name, row in world.bases.items()
        }
        self.grippers = {
            name: Gripper(row, (joints[row.left], joints[row.right]), engine)
            for name, row in world.grippers.items()
        }
        self.contacts = {
            name: ContactSensor(name, row, physics, params.proximity, seed)
            for name, row in world.contacts.items()
        }
        self.felt: list[Any] = []
        lens = Lens(params.camera, seed)
        self.cameras = {
            name: Camera(name, row, physics.links[row.link], engine, lens)
            for name, row in world.cameras.items()
        }
        for camera in self.cameras.values():
            camera.is_disabled = not params.cameras
        self._views = views(self.cameras)
        self.has_images = False
        self._sensors: dict[str, Any] = {
            f"{section}/{name}": device
            for section in ("bases", "grippers", "contacts")
            for name, device in getattr(self, section).items()
        }

    def owners(self) -> dict[str, str]:
        """Return joint → the base or gripper it belongs to."""
        return {
            joint.name: name
            for devices in (self.bases, self.grippers)
            for name, device in devices.items()
            for joint in device.joints
        }

    def sensor(self, port: str, port_type: str) -> tuple[Sensor, int]:
        """Return the sensor of an output, and how often it is read [ns].

        It is the one named like the port, or the only one. Raises WiringError where there is none.
        """
        if port_type in TYPES.values():
            fitting = [name for name, view in self._views.items() if view.port_type == port_type]
            if port not in fitting:
                names = f"name it one of {', '.join(fitting)}"
                known = names if self._views else "the world has no 'cameras'"
                raise WiringError(f"has type {port_type}; {known}")
            camera = self._views[port].camera
            self.has_images = True
            # One with a latency puts its images out at other steps than it takes them.
            period_ns = None if camera.latency_ns else camera.period_ns
            return self._views[port], period_ns or self._period_ns
        section = STATES[port_type]
        name, row = self._choose(section, port, port_type)
        key = f"{section}/{name}"
        if key not in self._sensors:
            self._sensors[key] = _MADE_WHEN_NEEDED[section](key, row, self._physics, self._seed)
        device = self._sensors[key]
        if isinstance(device, ContactSensor) and device not in self.felt:
            self.felt.append(device)
        return device, getattr(row, "period_ns", None) or self._period_ns

    def driver(self, port: str, port_type: str, motors: Motors) -> Commander:
        """Return the driver of the device of an input; raises as `sensor`."""
        name, _ = self._choose(COMMANDS[port_type], port, port_type)
        if port_type == TRIGGER:
            return TriggerDriver(port, self.cameras[name], motors)
        if port_type == "BaseCommand/1":
            return BaseDriver(port, self.bases[name], motors)
        return GripperDriver(port, self.grippers[name], motors)

    def _choose(self, section: str, port: str, port_type: str) -> tuple[str, Any]:
        rows: Mapping[str, Any] = getattr(self._physics.world, section)
        if not rows:
            raise WiringError(f"has type {port_type}, but the world has no '{section}'")
        if port not in rows and len(rows) > 1:
            raise WiringError(
                f"has type {port_type}; name the port after one of the world's {section}: "
                f"{', '.join(rows)}"
            )
        name = port if port in rows else next(iter(rows))
        return name, rows[name]


def mistakes(physics: Physics, period_ns: int) -> Iterator[tuple[Keys, str]]:
    """Yield what is wrong with the devices of a world: keys of the world file, and a sentence.

    period_ns: length of the plant's step [ns].
    """
    world = physics.world
    for section, is_rotary in (("bases", True), ("grippers", False)):
        for name, row in getattr(world, section).items():
            for side, text in _pair_mistakes(row, physics, is_rotary=is_rotary):
                yield (section, name, side), text
    yield from _sensor_mistakes(physics, period_ns)


def _sensor_mistakes(physics: Physics, period_ns: int) -> Iterator[tuple[Keys, str]]:
    world = physics.world
    groups = [f"{body}/*" for body in physics.bodies]
    for section in _SENSORS:
        known = [*physics.links, *(groups if section == "contacts" else [])]
        for name, row in getattr(world, section).items():
            for keys, link in _links_of(row):
                if link not in known:
                    text = f"link {link!r} is unknown{suggest(link, known)}"
                    yield (section, name, *keys), text
            for key in ("period", "latency"):
                text = period_problem(getattr(row, f"{key}_ns", None), period_ns)
                if text:
                    yield (section, name, key), text
    joints = physics.all_joints()
    for name, sensor in world.wrenches.items():
        if sensor.joint not in joints:
            text = f"joint {sensor.joint!r} is unknown{suggest(sensor.joint, joints)}"
            yield ("wrenches", name, "joint"), text


def period_problem(period_ns: int | None, step_ns: int) -> str:
    """Return why the steps of a plant do not meet a period; empty: they do. None: each step."""
    if period_ns is None or period_ns % step_ns == 0:
        return ""
    period, step = format_duration(period_ns), format_duration(step_ns)
    return f"{period} is not a multiple of the plant's step ({step})"


def _links_of(row: Any) -> Iterator[tuple[Keys, str]]:
    """Yield the links that a row of the world file names, each with its key."""
    if hasattr(row, "link"):
        yield ("link",), row.link
    yield from ((("links", n), link) for n, link in enumerate(getattr(row, "links", None) or ()))
    if getattr(row, "parent", WORLD) != WORLD:
        yield ("parent",), row.parent


def _pair_mistakes(
    row: BaseSettings | GripperSettings, physics: Physics, *, is_rotary: bool
) -> Iterator[tuple[str, str]]:
    """Yield the mistakes about two joints that a device drives."""
    sides = {"left": row.left, "right": row.right}
    wrong = {
        side: text
        for side, name in sides.items()
        if (text := _joint_mistake(name, physics, is_rotary=is_rotary))
    }
    if wrong:
        yield from wrong.items()
    elif row.left == row.right:
        yield "right", f"{row.right!r} is already the joint of 'left'"
    elif physics.joints[row.left].body != physics.joints[row.right].body:
        yield "right", "belongs to a different body than 'left'"


def _joint_mistake(name: str, physics: Physics, *, is_rotary: bool) -> str:
    joint = physics.joints.get(name)
    if joint is None:
        return f"joint {name!r} {physics.lacks_joint(name)}"
    if joint.is_rotary != is_rotary:
        return f"joint {name!r} is {joint.type}, not {'revolute' if is_rotary else 'prismatic'}"
    if joint.mimic is not None:
        return f"joint {name!r} follows {joint.mimic.joint!r} (<mimic>); set `mimic: false`"
    if joint.effective_mode != "velocity":
        return f"joint {name!r} has mode {joint.effective_mode}; set it to velocity"
    return ""
