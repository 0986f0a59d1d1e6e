"""Bodies that a class adds to a world, such as items on shelves."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol
from xml.etree import ElementTree as ET

from stepbus_participant import Problems, Settings, is_installed, load_class
from stepbus_participant.parameters import YamlFile, read
from stepbus_plant.world import WorldFile
from stepbus_schemas import WiringError


class Item(Protocol):
    """A body that a stock adds.

    name: of the body and its link. type: for the description of `Poses/1`. urdf: of one link.
    position [m], yaw [rad]: of the body's frame in the world. slot, slot_yaw: the same where it
    belongs, for a planogram. mass: scales the inertia of the URDF [kg]. friction,
    spinning_friction: [-].
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


class Stock(Protocol):
    """A class that `stock.source` of a world file names.

    World, Params: settings of the other keys of `stock`, and of the plant's `params.stock`. The
    constructor takes both, and the seed of the run.
    """

    World: type[Settings]
    Params: type[Settings]

    def __init__(self, world: Any, params: Any, seed: int, /) -> None: ...

    def items(self, problems: Problems, /) -> Sequence[Item]:
        """Return the bodies to add; problems: of the params, to which what is wrong is added."""
        ...


def draw_items(
    source: YamlFile,
    content: WorldFile,
    params: Mapping[str, Any] | None,
    *,
    seed: int,
    problems: Problems,
) -> list[Item]:
    """Return the items of a world file.

    params: `params.stock` of the plant; problems: of it. seed: of the run.
    Raises SettingsError that lists all mistakes.
    """
    if content.stock is None:
        if params is not None:
            problems.add((), "this world has no stock")
            problems.refuse()
        return []
    wrong, name = source.problems().below(("stock",)), content.stock.source
    folder = Path(source.file).absolute().parent
    stock = wrong.attempt(("source",), lambda: _load(name, folder))
    if stock is None:
        raise wrong.error()
    world = read(stock.World, content.stock.own, wrong, folder=folder)
    wrong.refuse()
    settings = read(stock.Params, params, problems)
    problems.refuse()
    items = list(stock(world, settings, seed).items(problems))
    problems.refuse()
    counts = Counter([*(item.name for item in items), *content.bodies])
    twice = [name for name, count in counts.items() if count > 1]
    source.refuse((("stock",), f"{name!r} names two bodies") for name in twice)
    return items


def _load(name: str, folder: Path) -> type[Stock]:
    """Return the class of a stock.

    Recordings hold world files: only what a recording holds too, or an installed package declares,
    may be imported for one.
    """
    module = name.rpartition(":")[0]
    is_beside = module.endswith(".py") and "/" not in module
    if not (is_beside or is_installed(module)):
        raise WiringError(
            f"{name!r} must be a class in a file beside the world file, or in a package that "
            "declares participants"
        )
    return load_class(name, folder)


def fit(item: Item, root: ET.Element) -> None:
    """Edit the URDF of an item: name of the link, mass and inertia.

    Raises WiringError for a mass or an inertia that cannot be scaled.
    """
    for link in root.findall("link"):
        link.set("name", item.name)
        mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
        if mass is None or inertia is None:
            continue
        factor = item.mass / _number(item, mass, "value", positive=True)
        mass.set("value", repr(item.mass))
        for key in inertia.keys():  # noqa: SIM118  an element, not a mapping
            inertia.set(key, repr(_number(item, inertia, key) * factor))


def _number(item: Item, element: ET.Element, key: str, *, positive: bool = False) -> float:
    text = element.get(key, "")
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number) or (positive and number <= 0):
        wanted = "a number above 0" if positive else "a number"
        raise WiringError(
            f"{item.urdf}: {key}={text!r} of <{element.tag}> must be {wanted} for an item"
        )
    return number
