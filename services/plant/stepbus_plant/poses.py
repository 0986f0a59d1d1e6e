"""True poses of links, and where things belong."""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property

from stepbus_participant import Problems, suggest
from stepbus_plant.appearance import Appearance, appearances
from stepbus_plant.engine import BASE, Link
from stepbus_plant.geometry import Pose
from stepbus_plant.params import FixedPoint
from stepbus_plant.physics import Physics
from stepbus_plant.stock import Item
from stepbus_schemas import Description, Point, Poses, Quaternion

PLANOGRAM = "planogram"
"""Name of an output of type Poses/1 that shows where links belong, instead of the true poses."""
_CENTIMETRE = 0.01


class PoseSensor:
    """Reads poses of links in the world frame, without noise.

    links: those to read; None: all. A link is named as in its URDF, or `body/link` if bodies share
    the name. points: of links, by a name of their own; they are read as links are. problems: of the
    plant's params. Raises WiringError for unknown links.
    """

    def __init__(
        self,
        physics: Physics,
        links: Sequence[str] | None,
        points: Mapping[str, FixedPoint],
        problems: Problems,
    ) -> None:
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
                "shape": [link.shape for link in shown],
                "body": bodies,
                "type": [world.items[body].type if body in world.items else "" for body in bodies],
                "color": [
                    link.color if world.bodies[body].visuals else ""
                    for body, link in zip(bodies, shown, strict=True)
                ],
            },
        )

    def _appearances(self) -> list[Appearance]:
        """Return the appearance of each link; a point has none."""
        shown: dict[Link, Appearance] = {}
        for body in dict.fromkeys(body for body, _ in self._indices):
            by_name = appearances(self._physics.robots[body])
            links = self._engine.links(body).items()
            shown |= {link: by_name.get(name, Appearance()) for name, link in links}
        return [
            Appearance() if name in self._offsets else shown[index]
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
