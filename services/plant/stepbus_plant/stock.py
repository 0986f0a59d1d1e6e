"""The stock of a store: items of several types in slots, drawn from a seed."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import msgspec
import numpy as np

from stepbus_participant import suggest
from stepbus_participant.parameters import Keys
from stepbus_plant.params import ItemTypeChange, StockParams
from stepbus_plant.world import RowSettings, StockSettings
from stepbus_schemas import WiringError


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
    position: tuple[float, float, float]
    yaw: float
    slot: tuple[float, float, float]
    slot_yaw: float
    mass: float
    friction: float
    spinning_friction: float

    def make(self, root: ET.Element) -> None:
        """Edit the URDF of its type: name of the link, mass and inertia.

        Raises WiringError for a mass or an inertia that cannot be scaled.
        """
        for link in root.findall("link"):
            link.set("name", self.name)
            mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
            if mass is None or inertia is None:
                continue
            factor = self.mass / self._number(mass, "value", positive=True)
            mass.set("value", repr(self.mass))
            for key in inertia.keys():  # noqa: SIM118  an element, not a mapping
                inertia.set(key, repr(self._number(inertia, key) * factor))

    def _number(self, element: ET.Element, key: str, *, positive: bool = False) -> float:
        text = element.get(key, "")
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number) or (positive and number <= 0):
            wanted = "a number above 0" if positive else "a number"
            raise WiringError(
                f"{self.urdf}: {key}={text!r} of <{element.tag}> must be {wanted} for an item type"
            )
        return number


@dataclass(frozen=True)
class _Slot:
    """A slot on a shelf; yaw: heading that faces it [rad]."""

    row: str
    number: int
    position: tuple[float, float, float]
    yaw: float


def draw_items(stock: StockSettings, params: StockParams) -> list[Item]:
    """Return the items of a world, in the order of its rows.

    The types share the slots as equally as possible. The random numbers are drawn for every slot,
    so that missing and changed items do not affect the others.
    """
    rng = np.random.Generator(np.random.PCG64(params.number))
    slots = list(_slots(stock.rows))
    names = list(stock.types)
    types = [names[n % len(names)] for n in rng.permutation(len(slots))]
    is_filled = rng.permutation(len(slots)) < round(params.fill * len(slots))
    spreads = rng.uniform(-1.0, 1.0, (len(slots), 5)).tolist()
    return [
        item
        for slot, name, filled, draws in zip(slots, types, is_filled, spreads, strict=True)
        if filled and not _is_named(item := _item(stock, params, slot, name, draws), params.missing)
    ]


def _slots(rows: Mapping[str, RowSettings]) -> Iterator[_Slot]:
    for name, row in rows.items():
        for number in range(1, row.count + 1):
            right = (number - (row.count + 1) / 2) * row.pitch
            position = _moved(row.position, row.yaw, 0.0, -right)
            yield _Slot(name, number, position, row.yaw)


def _moved(
    position: tuple[float, float, float], yaw: float, ahead: float, left: float
) -> tuple[float, float, float]:
    c, s = math.cos(yaw), math.sin(yaw)
    x, y, z = position
    return (x + c * ahead - s * left, y + s * ahead + c * left, z)


def _item(
    stock: StockSettings, params: StockParams, slot: _Slot, name: str, draws: Sequence[float]
) -> Item:
    """Return the item in a slot; draws: five numbers in [-1, 1]."""
    change, spread = params.types.get(name, ItemTypeChange()), stock.spread
    changed = {k: v for k, v in msgspec.structs.asdict(change).items() if v is not None}
    item_type = msgspec.structs.replace(stock.types[name], **changed)
    ahead, left, yaw, mass, friction = draws
    return Item(
        name=f"{name}_{slot.row}_{slot.number}",
        type=name,
        urdf=item_type.urdf,
        position=_moved(slot.position, slot.yaw, ahead * spread.position, left * spread.position),
        yaw=slot.yaw + yaw * spread.yaw,
        slot=slot.position,
        slot_yaw=slot.yaw,
        mass=item_type.mass * (1.0 + mass * spread.mass),
        friction=item_type.friction * (1.0 + friction * spread.friction),
        spinning_friction=item_type.spinning_friction,
    )


def _is_named(item: Item, names: Sequence[str]) -> bool:
    """Return whether one of the names is that of an item, its type, slot or row."""
    slot = item.name.removeprefix(f"{item.type}_")
    return any(name in (item.name, item.type, slot, slot.rpartition("_")[0]) for name in names)


def stock_problems(
    stock: StockSettings, params: StockParams, bodies: Sequence[str]
) -> list[tuple[Keys, str]]:
    """Return the mistakes in the stock of a world; bodies: the other ones."""
    items = draw_items(stock, msgspec.structs.replace(params, fill=1.0, missing=()))
    counts = Counter([*(item.name for item in items), *bodies])
    return [
        (("stock",), f"{name!r} names two bodies") for name, count in counts.items() if count > 1
    ]


def params_problems(stock: StockSettings | None, params: StockParams) -> Iterator[tuple[Keys, str]]:
    """Yield the mistakes in `params.stock`; stock None: the world has none."""
    if stock is None:
        yield (), "this world has no stock"
        return
    items = draw_items(stock, StockParams(seed=params.seed))
    slots = [f"{slot.row}_{slot.number}" for slot in _slots(stock.rows)]
    known = [*(item.name for item in items), *slots, *stock.rows, *stock.types]
    for name in params.types:
        if name not in stock.types:
            yield ("types", name), f"unknown item type {name!r}{suggest(name, stock.types)}"
    for name in params.missing:
        if name not in known:
            yield ("missing",), f"{name!r} is unknown{suggest(name, known)}"
