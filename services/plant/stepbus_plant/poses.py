"""True poses of links, and where things belong."""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property

from stepbus_models import Link as DescribedLink
from stepbus_models import Shape
from stepbus_participant import Problems, suggest
from stepbus_plant.engine import BASE, Link
from stepbus_plant.geometry import Pose, quaternion
from stepbus_plant.params import FixedPoint
from stepbus_plant.physics import Physics
from stepbus_plant.world_file import Item
from stepbus_schemas import Description, Point, Poses, Quaternion

PLANOGRAM = "planogram"
"""Name of an output of type Poses/1 that shows where links belong, instead of the true poses."""
_CENTIMETRE = 0.01
_ONLY_NAMED = ("mesh", "plane")


class PoseSensor:
    """Reads poses of links in the world frame, without noise.

    links: those to read; None: all. A link is named as in its URDF, or `body/link` if bodies share
    the name. points: of links, by a name of their own; they are read as links are. problems: of the
    plant's params. Raises WiringError for unknown links.
    """

    def __init__(
        self,
        physics: Physics,
        links: Sequence[str] | None = None,
        points: Mapping[str, FixedPoint] = {},
        problems: Problems | None = None,
    ) -> None:
        problems = Problems(above=("params",)) if problems is None else problems
        known = dict(physics.links)
        for name, point in points.items():
            if name in known:
                problems.add(("points",), f"{name!r} is already the name of a link")
            if point.link not in known:
                text = f"link {point.link!r} is unknown{suggest(point.link, known)}"
                problems.add(("points", name), text)
        problems.refuse()
        known |= {name: known[point.link] for name, point in points.items()}
        self.names = list(known if links is None else links)
        for name in self.names:
            if name not in known:
                problems.add(("poses",), f"link {name!r} is unknown{suggest(name, known)}")
        problems.refuse()
        self._physics = physics
        self._engine = physics.engine
        self._offsets = {name: point.position for name, point in points.items()}
        self._indices = [known[name] for name in self.names]
        self._moved = [
            (n, self._offsets[k]) for n, k in enumerate(self.names) if k in self._offsets
        ]
        self._roots = [index for index in dict.fromkeys(self._indices) if index[1] == BASE]
        self._others: dict[int, list[int]] = {}
        for body, link in self._indices:
            if link != BASE:
                self._others.setdefault(body, []).append(link)

    def sense(self, _t_ns: int = 0) -> Poses:
        """Return the current poses of the links."""
        frames: dict[Link, Pose] = {root: self._engine.frame(root) for root in self._roots}
        for body, links in self._others.items():
            poses = zip(links, self._engine.frames(body, links), strict=True)
            frames |= {(body, link): pose for link, pose in poses}
        position: list[Point] = [frames[index][0] for index in self._indices]
        orientation: list[Quaternion] = [frames[index][1] for index in self._indices]
        for number, offset in self._moved:
            position[number] = self._engine.geometry.out_of(frames[self._indices[number]], offset)
        return Poses(position=position, orientation=orientation)

    @cached_property
    def description(self) -> Description:
        """Names of the links, with body, shapes and colour of each."""
        world = self._physics.world
        bodies = [self._physics.bodies[body] for body, _ in self._indices]
        shown = self._appearances()
        return Description(
            names=self.names,
            details={
                "shape": [shape for shape, _ in shown],
                "body": bodies,
                "type": [world.items[body].type if body in world.items else "" for body in bodies],
                "color": [
                    colour if world.bodies[body].visuals else ""
                    for body, (_, colour) in zip(bodies, shown, strict=True)
                ],
            },
        )

    def _appearances(self) -> list[tuple[str, str]]:
        """Return collision shapes and colour of each link, as text; a point has none.

        Lengths are in [m], quaternions x, y, z, w, and colours r, g, b (0 to 1). The engine cannot
        report them: it turns a cylinder into a mesh, and gives shapes relative to the centre of
        mass.
        """
        shown: dict[Link, tuple[str, str]] = {}
        for body in dict.fromkeys(body for body, _ in self._indices):
            described = self._physics.robots[body].links
            links = self._engine.links(body).items()
            shown |= {link: _appearance(described[name]) for name, link in links}
        return [
            ("", "") if name in self._offsets else shown[index]
            for name, index in zip(self.names, self._indices, strict=True)
        ]


class Planogram:
    """Where links belong, as far as one knows that without looking.

    Items of a stock are in their slots, to the centimetre; all else is as surveyed before the run.
    """

    def __init__(self, sensor: PoseSensor, items: Mapping[str, Item]) -> None:
        self.description = sensor.description
        true = sensor.sense()
        rows = zip(sensor.names, true.position, true.orientation, strict=True)
        slots = [_slot(items[name]) if name in items else (at, turn) for name, at, turn in rows]
        self.poses = Poses(
            position=[at for at, _ in slots], orientation=[turn for _, turn in slots]
        )

    def sense(self, t_ns: int) -> Poses | None:
        """Return the poses at the start; None later on."""
        return self.poses if t_ns == 0 else None


def _slot(item: Item) -> Pose:
    x, y = (round(value / _CENTIMETRE) * _CENTIMETRE for value in item.slot[:2])
    half = item.slot_yaw / 2
    return (x, y, item.slot[2]), (0.0, 0.0, math.sin(half), math.cos(half))


def _appearance(link: DescribedLink) -> tuple[str, str]:
    colours = (_text(seen.rgba[:3]) for seen in link.visuals if seen.rgba is not None)
    return "; ".join(map(_shape, link.collisions)), next(colours, "")


def _shape(shape: Shape) -> str:
    size = () if shape.kind in _ONLY_NAMED else shape.size
    pose = (*shape.pose.xyz, *quaternion(shape.pose.rpy))
    return " ".join(filter(None, (shape.kind, _text(size), "@", _text(pose))))


def _text(numbers: Sequence[float]) -> str:
    # Nine digits hide the last bits of sines; adding 0 removes the sign of a zero.
    return " ".join(f"{round(number, 9) + 0.0:.9g}" for number in numbers)
