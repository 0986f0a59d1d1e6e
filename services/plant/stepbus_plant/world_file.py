"""Reads a world file: resolves its models, and adds the bodies of its stock."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from stepbus_models import RobotDescription
from stepbus_participant import Problems, Settings, is_installed, load_class
from stepbus_participant.parameters import YamlFile, read
from stepbus_plant.world import Body, Friction, WorldFile, read_world
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
        """Return the bodies to add; problems: of the params, to which mistakes are added."""
        ...


class World(WorldFile):
    """Everything that is simulated; `urdf` and `srdf` of each body are absolute paths.

    source: the file, which knows the line of each key. items: by the name of their body.
    """

    source: YamlFile
    items: dict[str, Item] = {}  # noqa: RUF012  Settings copy their defaults


def load_world(
    path: Path,
    stock: Mapping[str, Any] | None = None,
    problems: Problems | None = None,
    *,
    seed: int = 0,
) -> World:
    """Read a world file.

    stock: `params.stock` of the plant; problems: of it. seed: of the run. Raises SettingsError that
    lists all mistakes, each with file and line. Loading the world reports those that only the URDFs
    reveal.
    """
    source, content, mistakes = read_world(path)
    mistakes.refuse()
    problems = Problems(above=("params", "stock")) if problems is None else problems
    items = _drawn(source, content, stock, seed=seed, problems=problems)
    fields = {key: getattr(content, key) for key in content.__struct_fields__}
    bodies = fields["bodies"] = dict(content.bodies)
    for item in items:
        bodies[item.name] = Body(
            urdf=item.urdf,
            position=item.position,
            orientation_rpy=(0.0, 0.0, item.yaw),
            friction=Friction(lateral=item.friction, spinning=item.spinning_friction),
        )
    return World(**fields, source=source, items={item.name: item for item in items})


def fitted(item: Item, robot: RobotDescription) -> RobotDescription:
    """Return the robot of an item with the name, mass and inertia that the item has.

    Raises WiringError for a model of several links, or without a mass that can be scaled.
    """
    link = robot.links[robot.root]
    inertial = link.inertial
    if len(robot.links) > 1 or inertial is None or inertial.mass <= 0.0:
        raise WiringError(f"{item.urdf}: an item must be one link with a mass above 0")
    factor = item.mass / inertial.mass
    xx, yy, zz, xy, xz, yz = (moment * factor for moment in inertial.moments)
    scaled = replace(inertial, mass=item.mass, moments=(xx, yy, zz, xy, xz, yz))
    links = {item.name: replace(link, name=item.name, inertial=scaled)}
    return replace(robot, root=item.name, links=links)


def _drawn(
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
