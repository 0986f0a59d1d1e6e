"""The sensors of a world, and the port of each."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import pybullet as bullet

from stepbus_participant import format_duration, suggest
from stepbus_participant.parameters import Keys
from stepbus_plant.frames import TransformSensor
from stepbus_plant.poses import LinkIndex, link_indices
from stepbus_plant.readings import ImuSensor, Lidar, WrenchSensor
from stepbus_plant.world_file import World
from stepbus_plant.world_sensors import WORLD
from stepbus_schemas import Description, Message, WiringError

SECTIONS: Mapping[str, str] = {
    "Imu/1": "imus",
    "LaserScan/1": "lidars",
    "Transforms/1": "transforms",
    "Wrench/1": "wrenches",
}
"""Type of a port → section of the world file that declares its sensors."""


class Sensor(Protocol):
    """A sensor that is read when it is due."""

    def describe(self) -> Description:
        """Return what it is on."""
        ...

    def sense(self, t_ns: int) -> Message:
        """Return its reading at a time [ns]."""
        ...


class _Timed(NamedTuple):
    """A sensor and the time between two readings [ns]."""

    sensor: Sensor
    period_ns: int


class WorldSensors:
    """All sensors that a world file declares; each is made when a port needs it.

    bodies: names of the engine's bodies, in its order. period_ns: length of the plant's step [ns].
    seed: of the plant. Raises WiringError that lists every mistake, each with its line.
    """

    def __init__(
        self, world: World, client: int, bodies: Sequence[str], period_ns: int, seed: int
    ) -> None:
        self._world = world
        self._client = client
        self._period_ns = period_ns
        self._seed = seed
        self._rows: Mapping[str, Mapping[str, Any]] = {
            key: getattr(world, key) for key in SECTIONS.values()
        }
        has_any = any(self._rows.values())
        self._links = link_indices(client, bodies) if has_any else {}
        self._joints = _joint_indices(client, bodies) if has_any else {}
        world.source.refuse(list(self._problems()))

    def _problems(self) -> Iterator[tuple[Keys, str]]:
        for key, rows in self._rows.items():
            for name, row in rows.items():
                for below, link in row.named_links():
                    if link not in self._links:
                        text = f"link {link!r} is unknown{suggest(link, self._links)}"
                        yield (key, name, *below), text
                if row.period_ns is not None and row.period_ns % self._period_ns:
                    period = format_duration(row.period_ns)
                    step = format_duration(self._period_ns)
                    text = f"{period} is not a multiple of the plant's step ({step})"
                    yield (key, name, "period"), text
        for name, row in self._rows["wrenches"].items():
            if row.joint not in self._joints:
                text = f"joint {row.joint!r} is unknown{suggest(row.joint, self._joints)}"
                yield ("wrenches", name, "joint"), text

    def ports(self, types: Mapping[str, str]) -> dict[str, _Timed]:
        """Return the sensor of each port: the one named like it, or the only one of its type.

        types: port → message type. Raises WiringError that lists the ports without a sensor.
        """
        chosen = {
            port: _choose(port, name, self._rows[SECTIONS[name]]) for port, name in types.items()
        }
        problems = [sensor for sensor in chosen.values() if isinstance(sensor, WiringError)]
        if problems:
            raise WiringError("\n".join(map(str, problems)))
        made: dict[tuple[str, str], _Timed] = {}
        for port, name in chosen.items():
            key = SECTIONS[types[port]], str(name)
            if key not in made:
                period_ns = self._rows[key[0]][key[1]].period_ns or self._period_ns
                made[key] = _Timed(self._make(*key), period_ns)
        return {port: made[SECTIONS[types[port]], str(name)] for port, name in chosen.items()}

    def _make(self, section: str, name: str) -> Sensor:
        row, client, seed = self._rows[section][name], self._client, self._seed
        if section == "imus":
            gravity = np.array(self._world.gravity)
            return ImuSensor(name, row, self._links[row.link], client, gravity=gravity, seed=seed)
        if section == "wrenches":
            return WrenchSensor(name, row, self._joints[row.joint], client, seed)
        if section == "lidars":
            return Lidar(name, row, self._links[row.link], client, seed)
        links = [(link, self._links[link]) for link in row.links]
        parent = None if row.parent == WORLD else self._links[row.parent]
        return TransformSensor(name, row, links, parent, client, seed=seed)


def _joint_indices(client: int, bodies: Sequence[str]) -> dict[str, LinkIndex]:
    """Return each joint's unique name → its index in the engine, fixed ones included."""
    indices = [
        (body, bullet.getJointInfo(number, joint, client)[1].decode(), (number, joint))
        for number, body in enumerate(bodies)
        for joint in range(bullet.getNumJoints(number, physicsClientId=client))
    ]
    names = [name for _, name, _ in indices]
    return {
        name if names.count(name) == 1 else f"{body}/{name}": index for body, name, index in indices
    }


def _choose(port: str, port_type: str, rows: Mapping[str, Any]) -> str | WiringError:
    if port in rows:
        return port
    if len(rows) == 1:
        return next(iter(rows))
    section = SECTIONS[port_type]
    if not rows:
        return WiringError(f"{port}: has type {port_type}, the world has no '{section}'")
    return WiringError(
        f"{port}: has type {port_type}; name the port after one of the world's {section}: "
        f"{', '.join(rows)}"
    )
