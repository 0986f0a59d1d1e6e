"""The stock of a store: items of several kinds that stand on places, drawn from a seed."""

from __future__ import annotations

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
from stepbus_schemas import WiringError

from .declaration import KindChange, PlacesRow, StockParams, StockRow


@dataclass(frozen=True, kw_only=True)
class Item:
    """One piece of goods.

    name: `<kind>_<row>_<number>`, which its body and its link bear. position: of the middle of its
    bottom in the world [m]. yaw: [rad]. mass: [kg]. friction, spinning_friction: [-].
    """

    name: str
    kind: str
    urdf: Path
    position: tuple[float, float, float]
    yaw: float
    mass: float
    friction: float
    spinning_friction: float

    def make(self, root: ET.Element) -> None:
        """Turn the URDF of its kind into its own: name of the link, mass and inertia.

        Raises WiringError for a mass or an inertia that cannot be scaled.
        """
        for link in root.findall("link"):
            link.set("name", self.name)
            mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
            if mass is None or inertia is None:
                continue
            factor = self.mass / self._number(mass, "value", positive=True)
            mass.set("value", repr(self.mass))
            for key in inertia.keys():  # noqa: SIM118  an element, no mapping
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
                f"{self.urdf}: {key}={text!r} of <{element.tag}> is not {wanted}, which a kind of "
                "the stock needs"
            )
        return number


@dataclass(frozen=True)
class _Place:
    """A place on a shelf, before anything stands on it; yaw: of who faces it [rad]."""

    row: str
    number: int
    position: tuple[float, float, float]
    yaw: float


def draw_items(stock: StockRow, params: StockParams) -> list[Item]:
    """Return the items of a world, in the order of its rows.

    Every kind is on as many places as every other one, as far as that goes. What one parameter
    takes away or changes leaves all else as it is: numbers are drawn for every place.
    """
    rng = np.random.Generator(np.random.PCG64(params.seed))
    places = list(_places(stock.places))
    names = list(stock.kinds)
    kinds = [names[n % len(names)] for n in rng.permutation(len(places))]
    is_filled = rng.permutation(len(places)) < round(params.fill * len(places))
    spreads = rng.uniform(-1.0, 1.0, (len(places), 5)).tolist()
    return [
        item
        for place, kind, filled, spread in zip(places, kinds, is_filled, spreads, strict=True)
        if filled and not _bears(item := _item(stock, params, place, kind, spread), params.missing)
    ]


def _places(rows: Mapping[str, PlacesRow]) -> Iterator[_Place]:
    for name, row in rows.items():
        for number in range(1, row.count + 1):
            right = (number - (row.count + 1) / 2) * row.pitch
            position = _moved(row.position, row.yaw, 0.0, -right)
            yield _Place(name, number, position, row.yaw)


def _moved(
    position: tuple[float, float, float], yaw: float, ahead: float, left: float
) -> tuple[float, float, float]:
    c, s = math.cos(yaw), math.sin(yaw)
    x, y, z = position
    return (x + c * ahead - s * left, y + s * ahead + c * left, z)


def _item(
    stock: StockRow, params: StockParams, place: _Place, name: str, draws: Sequence[float]
) -> Item:
    """Return what stands on a place. draws: five numbers in [-1, 1]."""
    change, spread = params.kinds.get(name, KindChange()), stock.spread
    said = {k: v for k, v in msgspec.structs.asdict(change).items() if v is not None}
    kind = msgspec.structs.replace(stock.kinds[name], **said)
    ahead, left, yaw, mass, friction = draws
    return Item(
        name=f"{name}_{place.row}_{place.number}",
        kind=name,
        urdf=kind.urdf,
        position=_moved(place.position, place.yaw, ahead * spread.position, left * spread.position),
        yaw=place.yaw + yaw * spread.yaw,
        mass=kind.mass * (1.0 + mass * spread.mass),
        friction=kind.friction * (1.0 + friction * spread.friction),
        spinning_friction=kind.spinning_friction,
    )


def _bears(item: Item, names: Sequence[str]) -> bool:
    """Return whether one of the names means an item."""
    place = item.name.removeprefix(f"{item.kind}_")
    return any(name in (item.name, item.kind, place, place.rpartition("_")[0]) for name in names)


def stock_problems(
    stock: StockRow, params: StockParams, bodies: Sequence[str]
) -> list[tuple[Keys, str]]:
    """Return what is wrong with a stock of a world; bodies: the other ones."""
    items = draw_items(stock, msgspec.structs.replace(params, fill=1.0, missing=()))
    counts = Counter([*(item.name for item in items), *bodies])
    return [
        (("stock",), f"{name!r} is the name of two bodies")
        for name, count in counts.items()
        if count > 1
    ]


def params_problems(stock: StockRow | None, params: StockParams) -> list[str]:
    """Return what is wrong with `params.stock`, as whole sentences; None: there is no stock."""
    if stock is None:
        return ["params.stock: this world has no stock"]
    items = draw_items(stock, StockParams(seed=params.seed))
    places = [f"{place.row}_{place.number}" for place in _places(stock.places)]
    known = [*(item.name for item in items), *places, *stock.places, *stock.kinds]
    kinds = list(stock.kinds)
    return [
        *(
            f"params.stock.kinds.{name}: unknown{suggest(name, kinds)}"
            for name in params.kinds
            if name not in kinds
        ),
        *(
            f"params.stock.missing: {name!r} is unknown{suggest(name, known)}"
            for name in params.missing
            if name not in known
        ),
    ]
