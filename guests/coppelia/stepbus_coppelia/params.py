"""Parameters of the gateway."""

from typing import Annotated, Any

import msgspec

from stepbus_coppelia.proximity import ProximitySettings
from stepbus_participant import Duration, Settings

_PORT = 23000
_Port = Annotated[int, msgspec.Meta(ge=0, le=65535)]


class GatewayParams(Settings):
    """Parameters of `stepbus_coppelia:Gateway`."""

    command: tuple[str, ...] = ()
    """Program that it starts, with its arguments; `stepbus coppelia` puts it there. Default: it
    waits for a script that you start."""
    port: _Port = _PORT
    """Port of the ZeroMQ remote API, on this machine only; 0: any that is free."""
    legacy_ports: tuple[_Port, ...] = (19997,)
    """Ports of the legacy remote API."""
    aliases: dict[str, str] = {}
    """Path that scripts use, such as `/Pioneer/leftMotor` → joint, link, body, camera or sensor of
    the world."""
    proximity_sensors: dict[str, ProximitySettings] = {}
    """Proximity sensors by name."""
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
