"""Parameters of the gateway."""

from typing import Annotated, Any

import msgspec

from stepbus_participant import Duration, NonNegative, Positive, Settings, Vector3

_Port = Annotated[int, msgspec.Meta(ge=0, le=65535)]


class ProximitySettings(Settings):
    """A proximity sensor, which looks along the z axis of its frame."""

    link: str
    """Link that it is on, named as in `poses`."""
    position: Vector3 = (0.0, 0.0, 0.0)
    """Its frame in the frame of the link [m]."""
    orientation_rpy: Vector3 = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw of its frame [rad]."""
    range: Positive = 1.0
    """[m]"""
    offset: NonNegative = 0.0
    """Nearest distance that it detects [m]."""
    angle: NonNegative = 0.0
    """Opening angle of its cone [rad]; 0: a ray."""


class Params(Settings):
    """Parameters of `stepbus_coppelia:Gateway`."""

    command: tuple[str, ...] = ()
    """Program that it starts, with its arguments; `stepbus coppelia` puts it there. Default: it
    waits for a script that you start."""
    port: _Port = 23000
    """Port of the ZeroMQ remote API, on this machine only; 0: any that is free."""
    legacy_ports: tuple[_Port, ...] = (19997,)
    """Ports of the legacy remote API."""
    aliases: dict[str, str] = {}
    """Path that scripts use, such as `/Pioneer/leftMotor` → joint, link, body, camera or sensor of
    the world."""
    proximity_sensors: dict[str, ProximitySettings] = {}
    """Proximity sensors by name."""
    collisions: dict[str, tuple[str, str]] = {}
    """Collision object of `simxGetCollisionHandle` → paths of the two objects; that of a robot
    stands for all of its links."""
    scenes: dict[str, str] = {}
    """File that scripts load, such as `robot.ttt` → world file."""
    models: dict[str, str] = {}
    """File that scripts load, such as `cup.ttm` → URDF."""
    functions: str = ""
    """Class with methods that stand for functions of Lua scripts: `file.py:Class`."""
    start: bool = False
    """Whether the simulation starts when a script connects, as if by CoppeliaSim's button."""
    client_timeout_ns: Duration = 30_000_000_000
    """How long a client that steps the simulation may keep it from its next step."""
    plant: dict[str, Any] = {}
    """Parameters of the plant; `stepbus coppelia` puts them there."""
    plant_seed: int = 0
    """Seed of the plant; likewise."""
