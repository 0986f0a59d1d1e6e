"""The planogram: where things belong, as far as the shop knows that without looking."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Protocol

from stepbus_participant import Problems, suggest
from stepbus_participant.parameters import Keys
from stepbus_plant.commander import Commander
from stepbus_plant.contacts import ContactSensor, name_links
from stepbus_plant.device import Base, BaseDriver
from stepbus_plant.engine import Physics
from stepbus_plant.gripper import Gripper, GripperDriver
from stepbus_plant.joint import Joint
from stepbus_plant.params import Params
from stepbus_plant.poses import LinkIndex, link_indices
from stepbus_plant.readings import Noise
from stepbus_plant.sensing import Warnings
from stepbus_plant.stock import Item
from stepbus_plant.world import BaseSettings, GripperSettings
from stepbus_plant.world_file import World
from stepbus_schemas import Description, Message, Point, Poses, Quaternion, WiringError

PORT = "planogram"
"""Name of an output of type Poses/1 that carries it, instead of the true poses."""

_CENTIMETRE = 0.01


def planogram(names: list[str], poses: Poses, items: Mapping[str, Item]) -> Poses:
    """Return where links belong: items in their slots, to the centimetre; all else as surveyed.

    names: of the links. poses: the true ones before the run. items: by the name of their link.
    """
    rows = zip(names, poses.position, poses.orientation, strict=True)
    slots = [_slot(items[name]) if name in items else (at, turn) for name, at, turn in rows]
    return Poses(position=[at for at, _ in slots], orientation=[turn for _, turn in slots])


def _slot(item: Item) -> tuple[Point, Quaternion]:
    x, y = (round(value / _CENTIMETRE) * _CENTIMETRE for value in item.slot[:2])
    half = item.slot_yaw / 2
    return (x, y, item.slot[2]), (0.0, 0.0, math.sin(half), math.cos(half))


INPUTS = ("BaseCommand/1", "GripperCommand/1")
OUTPUTS = ("BaseState/1", "Contacts/1", "GripperState/1")

_SECTIONS = {
    "BaseCommand/1": "bases",
    "BaseState/1": "bases",
    "Contacts/1": "contacts",
    "GripperCommand/1": "grippers",
    "GripperState/1": "grippers",
}
"""Type of a port → section of the world file that declares its devices."""


class Driver(Protocol):
    """Executes the commands of one input; a command holds until the next one."""

    def apply(self, command: Any) -> None:
        """Execute a command from now on.

        Raises CommandError for an invalid one.
        """
        ...

    def before_step(self) -> None:
        """Prepare a communication step, with or without a new command."""
        ...


class Device(Protocol):
    """A device that is sensed once per step."""

    def describe(self) -> Description:
        """Return its joints or links."""
        ...

    def sense(self) -> Message:
        """Return its current reading."""
        ...


class Devices:
    """All devices that a world file declares.

    bodies: names of the engine's bodies, in its order. owners: joint → the base or gripper it
    belongs to. params, seed: of their errors. Raises WiringError that lists every wrong joint and
    link of a device, each with its line.
    """

    def __init__(
        self,
        world: World,
        physics: Physics,
        bodies: Sequence[str],
        params: Params,
        seed: int,
    ) -> None:
        joints = {joint.name: joint for joint in physics.joints}
        indices = link_indices(physics.client, bodies)
        watched = {
            name: None if row.links is None else name_links(row.links, indices, bodies)
            for name, row in world.contacts.items()
        }
        world.source.refuse(
            [
                *_pair_problems("bases", world.bases, joints, rotary=True),
                *_pair_problems("grippers", world.grippers, joints, rotary=False),
                *_link_problems(watched, indices, bodies),
            ]
        )
        self._bases = {
            name: Base(
                row,
                joints[row.left],
                joints[row.right],
                physics,
                errors=params.odometry,
                noise=Noise(seed, "odometry", name),
            )
            for name, row in world.bases.items()
        }
        self._grippers = {
            name: Gripper(row, joints[row.left], joints[row.right], physics)
            for name, row in world.grippers.items()
        }
        self._contacts = {
            name: ContactSensor(
                watched[name],
                row.within,
                indices,
                physics.client,
                errors=params.proximity,
                random=Noise(seed, "proximity", name),
            )
            for name, row in world.contacts.items()
        }
        self.owners = {
            joint.name: name
            for devices in (self._bases, self._grippers)
            for name, device in devices.items()
            for joint in device.joints
        }

    @property
    def bases(self) -> list[Base]:
        """Return all bases."""
        return list(self._bases.values())

    @property
    def grippers(self) -> list[Gripper]:
        """Return all grippers."""
        return list(self._grippers.values())

    @property
    def contacts(self) -> list[ContactSensor]:
        """Return all contact sensors."""
        return list(self._contacts.values())

    def sensors(self, types: Mapping[str, str]) -> dict[str, Device]:
        """Return the device of each output: the one named like the port, or the only one.

        types: port → message type. Raises WiringError that lists the ports without a device.
        """
        groups: dict[str, Mapping[str, Device]] = {
            "bases": self._bases,
            "contacts": self._contacts,
            "grippers": self._grippers,
        }
        problems, by_port = Problems(), {}
        for port, port_type in types.items():
            devices = groups[_SECTIONS[port_type]]
            name = problems.attempt((), partial(_choose, port, port_type, list(devices)))
            if name is not None:
                by_port[port] = devices[name]
        problems.refuse()
        return by_port

    def driver(
        self,
        port: str,
        port_type: str,
        commander: Callable[[Sequence[str]], Commander],
        warnings: Warnings,
    ) -> Driver:
        """Return the driver of the device of an input.

        commander: makes one for joints. Raises WiringError if there is no such device.
        """
        if port_type == "BaseCommand/1":
            base = self._bases[_choose(port, port_type, list(self._bases))]
            return BaseDriver(port, base, commander([joint.name for joint in base.joints]))
        gripper = self._grippers[_choose(port, port_type, list(self._grippers))]
        fingers = commander([joint.name for joint in gripper.joints])
        return GripperDriver(port, gripper, fingers, warnings)


def _choose(port: str, port_type: str, names: Sequence[str]) -> str:
    if port in names:
        return port
    if len(names) == 1:
        return names[0]
    section = _SECTIONS[port_type]
    if not names:
        raise WiringError(f"{port}: has type {port_type}, the world has no '{section}'")
    raise WiringError(
        f"{port}: has type {port_type}; name the port after one of the world's {section}: "
        f"{', '.join(names)}"
    )


def _pair_problems(
    key: str,
    rows: Mapping[str, BaseSettings] | Mapping[str, GripperSettings],
    joints: Mapping[str, Joint],
    *,
    rotary: bool,
) -> list[tuple[Keys, str]]:
    """Return the mistakes about joints that devices drive in pairs."""
    problems: list[tuple[Keys, str]] = []
    for name, row in rows.items():
        sides = {"left": row.left, "right": row.right}
        wrong = [
            ((key, name, side), text)
            for side, joint in sides.items()
            if (text := _joint_problem(joint, joints, rotary=rotary))
        ]
        if not wrong and row.left == row.right:
            wrong = [((key, name, "right"), f"{row.right!r} is already the left joint")]
        elif not wrong and joints[row.left].body != joints[row.right].body:
            wrong = [((key, name, "right"), "belongs to a different body than 'left'")]
        problems += wrong
    return problems


def _joint_problem(name: str, joints: Mapping[str, Joint], *, rotary: bool) -> str | None:
    if name not in joints:
        return f"joint {name!r} is unknown{suggest(name, joints)}"
    joint = joints[name]
    if joint.is_rotary != rotary:
        return f"joint {name!r} is {joint.type}, not {'revolute' if rotary else 'prismatic'}"
    if joint.mimic is not None:
        return f"joint {name!r} follows {joint.mimic.joint!r} (<mimic>); give it `mimic: false`"
    if joint.effective_mode != "velocity":
        return f"joint {name!r} has mode {joint.effective_mode}; give it mode velocity"
    return None


def _link_problems(
    watched: Mapping[str, Sequence[str] | None],
    indices: Mapping[str, LinkIndex],
    bodies: Sequence[str],
) -> list[tuple[Keys, str]]:
    known = [*indices, *(f"{body}/*" for body in bodies)]
    return [
        (("contacts", name, "links"), f"link {link!r} is unknown{suggest(link, known)}")
        for name, links in watched.items()
        for link in links or ()
        if link not in indices
    ]
