"""The cube that the arm picks: the seed of the run draws where it stands, its mass and friction."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stepbus_participant import ModelFile, NonNegative, Positive, Problems, Settings, Share, Vector3


class Spread(Settings):
    """Half the width of each uniform distribution."""

    position: NonNegative = 0.0
    """Along x and y [m]."""
    yaw: NonNegative = 0.0
    """[rad]"""
    mass: Share = 0.0
    """Relative to the mass [-]."""
    friction: Share = 0.0
    """Relative to the friction [-]."""


class CubeSettings(Settings):
    """`stock` of a world file with a cube."""

    urdf: ModelFile
    """URDF of the cube, with its origin in the centre of the bottom."""
    mass: Positive
    """Mass [kg]."""
    friction: NonNegative = 0.8
    """Lateral friction [-]."""
    position: Vector3
    """Mean position of its bottom, in the world frame [m]."""
    spread: Spread = Spread()
    """Variation among runs."""


class CubeParams(Settings):
    """`params.stock` of the plant; absent: as in the world file."""

    mass: Positive | None = None
    """Mass [kg]."""
    friction: NonNegative | None = None
    """Lateral friction [-]."""


@dataclass(frozen=True, kw_only=True)
class Cube:
    """A cube, as `stepbus_plant.world_file.Item` describes it."""

    urdf: Path
    position: tuple[float, float, float]
    yaw: float
    slot: tuple[float, float, float]
    mass: float
    friction: float
    name: str = "cube_start_1"
    type: str = "cube"
    slot_yaw: float = 0.0
    spinning_friction: float = 0.002


class CubeStart:
    """Puts a cube into the world: a `stepbus_plant.world_file.Stock`."""

    World, Params = CubeSettings, CubeParams

    def __init__(self, world: CubeSettings, params: CubeParams, seed: int) -> None:
        self._world, self._params, self._seed = world, params, seed

    def items(self, _problems: Problems) -> Sequence[Cube]:
        """Return the cube."""
        world, params, spread = self._world, self._params, self._world.spread
        rng = np.random.Generator(np.random.PCG64(self._seed))
        dx, dy, yaw, mass, friction = rng.uniform(-1.0, 1.0, 5).tolist()
        x, y, z = world.position
        given = world.friction if params.friction is None else params.friction
        cube = Cube(
            urdf=world.urdf,
            position=(x + dx * spread.position, y + dy * spread.position, z),
            yaw=yaw * spread.yaw,
            slot=world.position,
            mass=(params.mass or world.mass) * (1.0 + mass * spread.mass),
            friction=given * (1.0 + friction * spread.friction),
        )
        return [cube]
