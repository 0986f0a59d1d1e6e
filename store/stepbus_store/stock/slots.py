"""The stock of a store: items of several types in slots, drawn from a seed."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from stepbus_participant import Problems, suggest
from stepbus_schemas import Point

from .params import ItemTypeChange, RowSettings, StockParams, StockSettings


@dataclass(frozen=True, kw_only=True)
class Item:
    """One item.

    name: `<type>_<row>_<number>`, also of its body and its link. position: of the middle of its
    bottom in the world [m]. yaw: [rad]. slot, slot_yaw: the same of the slot that it belongs in.
    mass: [kg]. friction, spinning_friction: [-].
    """

    name: str
    type: str
    urdf: Path
    position: Point
    yaw: float
    slot: Point
    slot_yaw: float
    mass: float
    friction: float
    spinning_friction: float


_Slot = tuple[str, Point, float]
"""A slot on a shelf: its name, `<row>_<number>`, its position [m], and the yaw facing it [rad]."""


class Stock:
    """Puts items on shelves: `stock.source` of a world file.

    world: keys of `stock`. params: those of the plant's `params.stock`. seed: of the run.
    """

    World, Params = StockSettings, StockParams

    def __init__(self, world: StockSettings, params: StockParams, seed: int) -> None:
        self._world, self._params = world, params
        self._seed = seed if params.seed == "run" else params.seed

    def items(self, problems: Problems) -> list[Item]:
        """Return the items in the order of the rows; problems: of the params.

        The types share the slots as equally as possible. The random numbers are drawn for every
        slot, so that missing and changed items do not affect the others.
        """
        world, params = self._world, self._params
        rng = np.random.Generator(np.random.PCG64(self._seed))
        slots, names = list(_slots(world.rows)), list(world.types)
        types = [names[n % len(names)] for n in rng.permutation(len(slots))]
        is_filled = rng.permutation(len(slots)) < round(params.fill * len(slots))
        spreads = rng.uniform(-1.0, 1.0, (len(slots), 5)).tolist()
        items = [self._item(*row) for row in zip(slots, types, spreads, strict=True)]
        known = {*world.types, *(name for item in items for name in _names(item))}
        for name in params.types:
            if name not in names:
                problems.add(("types", name), f"unknown item type {name!r}{suggest(name, names)}")
        for name in params.missing:
            if name not in known:
                problems.add(("missing",), f"{name!r} is unknown{suggest(name, sorted(known))}")
        return [
            item
            for item, filled in zip(items, is_filled, strict=True)
            if filled and not _names(item).intersection(params.missing)
        ]

    def _item(self, slot: _Slot, name: str, draws: Sequence[float]) -> Item:
        """Return the item in a slot; draws: five numbers in [-1, 1]."""
        change, spread = self._params.types.get(name, ItemTypeChange()), self._world.spread
        changed = {k: v for k, v in msgspec.structs.asdict(change).items() if v is not None}
        item_type = msgspec.structs.replace(self._world.types[name], **changed)
        (slot_name, position, slot_yaw), (ahead, left, yaw, mass, friction) = slot, draws
        offset = ahead * spread.position, left * spread.position
        return Item(
            name=f"{name}_{slot_name}",
            type=name,
            urdf=item_type.urdf,
            position=_moved(position, slot_yaw, *offset),
            yaw=slot_yaw + yaw * spread.yaw,
            slot=position,
            slot_yaw=slot_yaw,
            mass=item_type.mass * (1.0 + mass * spread.mass),
            friction=item_type.friction * (1.0 + friction * spread.friction),
            spinning_friction=item_type.spinning_friction,
        )


def _slots(rows: Mapping[str, RowSettings]) -> Iterator[_Slot]:
    for name, row in rows.items():
        for number in range(1, row.count + 1):
            right = (number - (row.count + 1) / 2) * row.pitch
            yield f"{name}_{number}", _moved(row.position, row.yaw, 0.0, -right), row.yaw


def _moved(position: Point, yaw: float, ahead: float, left: float) -> Point:
    c, s = math.cos(yaw), math.sin(yaw)
    x, y, z = position
    return (x + c * ahead - s * left, y + s * ahead + c * left, z)


def _names(item: Item) -> set[str]:
    """Return what names an item: its own name, its type, slot and row."""
    slot = item.name.removeprefix(f"{item.type}_")
    return {item.name, item.type, slot, slot.rpartition("_")[0]}
