"""The devices of a world, and which port belongs to which of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from stepbus_participant.settings import nearest
from stepbus_plant.checked import Problem
from stepbus_plant.joints.commander import Commander
from stepbus_plant.joints.warnings import Complaints
from stepbus_plant.physics.engine import Physics
from stepbus_plant.physics.joint import Joint
from stepbus_plant.world.file import BaseRow, GripperRow, World
from stepbus_schemas import Description, Message, WiringError

from .base import Base, BaseDriver
from .contacts import ContactSensor, name_links
from .gripper import Gripper, GripperDriver
from .poses import Place, link_places

INPUTS = ("BaseCommand/1", "GripperCommand/1")
OUTPUTS = ("BaseState/1", "Contacts/1", "GripperState/1")

_KINDS = {
    "BaseCommand/1": "bases",
    "BaseState/1": "bases",
    "Contacts/1": "contacts",
    "GripperCommand/1": "grippers",
    "GripperState/1": "grippers",
}
"""Type of a port → key of the world file under which its devices stand."""


class Driver(Protocol):
    """What carries out the commands of one input; a command holds until the next one."""

    def apply(self, command: Any) -> None:
        """Carry out a command from now on.

        Raises CommandError for one that cannot be carried out.
        """
        ...

    def before_step(self) -> None:
        """Do what is due before each communication step, with or without a new command."""
        ...


class Device(Protocol):
    """What is sensed once per step."""

    def describe(self) -> Description:
        """Return which joints or links it has."""
        ...

    def sense(self) -> Message:
        """Return what it shows now."""
        ...


class Devices:
    """All devices that a world file declares.

    bodies: names of the engine's bodies, in its order. owners: joint → the base or gripper it is
    of. Raises WiringError that lists every joint and link that a device names wrongly, each with
    its line.
    """

    def __init__(self, world: World, physics: Physics, bodies: Sequence[str]) -> None:
        joints = {joint.name: joint for joint in physics.joints}
        places = link_places(physics.client, bodies)
        watched = {
            name: None if row.links is None else name_links(row.links, places, bodies)
            for name, row in world.contacts.items()
        }
        world.source.refuse(
            [
                *_pair_problems("bases", world.bases, joints, rotary=True),
                *_pair_problems("grippers", world.grippers, joints, rotary=False),
                *_link_problems(world, watched, places, bodies),
            ]
        )
        self._bases = {
            name: Base(row, joints[row.left], joints[row.right], physics)
            for name, row in world.bases.items()
        }
        self._grippers = {
            name: Gripper(row, joints[row.left], joints[row.right], physics)
            for name, row in world.grippers.items()
        }
        self._contacts = {
            name: ContactSensor(watched[name], row.within, places, physics.client)
            for name, row in world.contacts.items()
        }
        self.owners = {
            joint.name: name
            for devices in (self._bases, self._grippers)
            for name, device in devices.items()
            for joint in device.joints
        }

    def sensor(self, port: str, kind: str) -> Device:
        """Return the device that an output shows; kind: type of the port.

        It is the one that is called like the port, or the only one there is.
        Raises WiringError where there is no such device.
        """
        groups: dict[str, Mapping[str, Device]] = {
            "bases": self._bases,
            "contacts": self._contacts,
            "grippers": self._grippers,
        }
        devices = groups[_KINDS[kind]]
        return devices[_choose(port, kind, list(devices))]

    def driver(
        self,
        port: str,
        kind: str,
        commander: Callable[[Sequence[str]], Commander],
        complaints: Complaints,
    ) -> Driver:
        """Return what carries out the commands of an input; kind: type of the port.

        commander: makes one for joints. Raises WiringError where there is no such device.
        """
        if kind == "BaseCommand/1":
            base = self._bases[_choose(port, kind, list(self._bases))]
            return BaseDriver(port, base, commander([joint.name for joint in base.joints]))
        gripper = self._grippers[_choose(port, kind, list(self._grippers))]
        fingers = commander([joint.name for joint in gripper.joints])
        return GripperDriver(port, gripper, fingers, complaints)


def _choose(port: str, kind: str, names: Sequence[str]) -> str:
    if port in names:
        return port
    if len(names) == 1:
        return names[0]
    if not names:
        raise WiringError(f"{port}: takes {kind}, the world has no '{_KINDS[kind]}'")
    raise WiringError(
        f"{port}: takes {kind}; call the port like one of the world's {_KINDS[kind]}: "
        f"{', '.join(names)}"
    )


def _pair_problems(
    key: str,
    rows: Mapping[str, BaseRow] | Mapping[str, GripperRow],
    joints: Mapping[str, Joint],
    *,
    rotary: bool,
) -> list[Problem]:
    """Return what is wrong with the joints that devices drive in pairs."""
    problems: list[Problem] = []
    for name, row in rows.items():
        sides = {"left": row.left, "right": row.right}
        found = [
            ((key, name, side), text)
            for side, joint in sides.items()
            if (text := _joint_problem(joint, joints, rotary=rotary))
        ]
        if not found and row.left == row.right:
            found = [((key, name, "right"), f"{row.right!r} is the left one already")]
        elif not found and joints[row.left].body != joints[row.right].body:
            found = [((key, name, "right"), "belongs to another body than the left one")]
        problems += found
    return problems


def _joint_problem(name: str, joints: Mapping[str, Joint], *, rotary: bool) -> str | None:
    if name not in joints:
        return f"joint {name!r} is unknown; {nearest(name, joints)}"
    joint = joints[name]
    if joint.is_rotary != rotary:
        return f"joint {name!r} is {joint.kind}; it has to {'turn' if rotary else 'slide'}"
    if joint.told_mode != "velocity":
        return f"joint {name!r} has mode {joint.told_mode}; give it mode velocity"
    return None


def _link_problems(
    world: World,
    watched: Mapping[str, Sequence[str] | None],
    places: Mapping[str, Place],
    bodies: Sequence[str],
) -> list[Problem]:
    problems: list[Problem] = [
        (("contacts", name, "within"), "needs 'links': near to which ones?")
        for name, row in world.contacts.items()
        if row.within and row.links is None
    ]
    known = [*places, *(f"{body}/*" for body in bodies)]
    return problems + [
        (("contacts", name, "links"), f"link {link!r} is unknown; {nearest(link, known)}")
        for name, links in watched.items()
        for link in links or ()
        if link not in places
    ]
