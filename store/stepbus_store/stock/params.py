"""The parameters of a stock: its section of the world file, and `params.stock` of the plant."""

from collections.abc import Iterator
from typing import Annotated, Literal

import msgspec

from stepbus_participant import (
    Finite,
    ModelFile,
    NonNegative,
    Positive,
    Settings,
    Share,
    Vector3,
    Whole,
)
from stepbus_participant.parameters import Keys


class ItemTypeSettings(Settings):
    """A type of item."""

    urdf: ModelFile
    """URDF of the item, resolved like that of a body; one link, with its origin in the centre
    of the bottom."""
    mass: Positive
    """Mass [kg]; scales the inertia of the URDF."""
    friction: NonNegative = 0.8
    """Lateral friction [-]; multiplied by that of the other body in a contact."""
    spinning_friction: NonNegative = 0.002
    """[-]"""


class RowSettings(Settings):
    """A row of slots, counted from 1, from left to right as seen from the front."""

    position: Vector3
    """Centre of the row at the bottom of the items, in the world frame [m]."""
    count: Annotated[int, msgspec.Meta(ge=1, le=1000)]
    """Number of slots."""
    pitch: Positive
    """Distance between two slots [m]."""
    yaw: Finite = 0.0
    """Heading of a robot that faces the row; also the yaw of the items [rad]."""


class SpreadSettings(Settings):
    """Variation among items: half the width of each uniform distribution."""

    position: NonNegative = 0.003
    """Half-width of the variation along and across the row [m]."""
    yaw: NonNegative = 0.05
    """[rad]"""
    mass: Share = 0.03
    """Relative to the type's [-]."""
    friction: Share = 0.05
    """Relative to the type's [-]."""


class StockSettings(Settings):
    """`stock` of a world file, of `stepbus_store.stock`."""

    types: dict[str, ItemTypeSettings]
    """Item types."""
    rows: dict[str, RowSettings]
    """Rows of slots."""
    spread: SpreadSettings = SpreadSettings()
    """Variation among items."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield an empty section."""
        for key, section in (("types", self.types), ("rows", self.rows)):
            if not section:
                yield (key,), "is empty; remove 'stock' instead"


class ItemTypeChange(Settings):
    """Changes of an item type in a run; absent: as in the world file."""

    mass: Positive | None = None
    friction: NonNegative | None = None
    spinning_friction: NonNegative | None = None


class StockParams(Settings):
    """`params.stock` of a plant with `stepbus_store.stock`."""

    seed: Whole | Literal["run"] = 0
    """Seed of the item type in each slot and of the variation among items. `run`: derived from
    the seed of the run, so that each run differs."""
    types: dict[str, ItemTypeChange] = {}
    """Item type → changes to it in this run."""
    fill: Share = 1.0
    """Fraction of the slots that have an item [-]."""
    missing: tuple[str, ...] = ()
    """Items (`cola_a1_3`), slots (`a1_3`), rows (`a1`) and types (`cola`) to omit."""
