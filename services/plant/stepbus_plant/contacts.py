"""A sensor of contacts, and the skin of a robot that measures how far away things are."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from stepbus_plant.engine import Contact, Link
from stepbus_plant.memory import Remembers
from stepbus_plant.noise import Noise
from stepbus_plant.params import ProximityErrors
from stepbus_plant.physics import Physics
from stepbus_plant.world import ContactSensorSettings
from stepbus_schemas import Contacts, Description, Point

_CALIBRATION = 0
"""Number of the reading that draws what stays the same during a run; the others count from 1."""
_STANDS_ON = 2e-3
"""What a robot is closer to at the start, it stands on [m]."""
Pair = tuple[str, str]
"""Names of two links, sorted."""


class Skin(Remembers):
    """Electrodes all over some links: each measures the nearest surface, wherever that is.

    links: those with a skin. errors: of its distances. random: numbers for that. readings: how many
    there were.
    """

    remembers = ("readings",)

    def __init__(self, links: Sequence[str], errors: ProximityErrors, random: Noise) -> None:
        self._noise, self._random = errors.noise, random
        gains = random.at(_CALIBRATION).normal(1.0, errors.gain, len(links)).tolist()
        self._gains: dict[str, float] = dict(zip(links, gains, strict=True))
        self.readings = _CALIBRATION

    def measure(self, links: Sequence[str], distances: Sequence[float]) -> list[float]:
        """Return what the skins of some links measure of these distances in a step [m], ≥ 0."""
        self.readings += 1
        if not links:
            return []
        noise = self._random.at(self.readings).normal(1.0, self._noise, len(links)).tolist()
        return [
            max(distance * self._gains[link] * factor, 0.0)
            for link, distance, factor in zip(links, distances, noise, strict=True)
        ]


class _Point(NamedTuple):
    """A point where two links touch or nearly touch; position: on the second link."""

    pair: Pair
    distance: float
    force: float
    position: Point


@dataclass
class _Load:
    """What has pressed on a pair of links since the latest reading.

    peak: largest force of a substep [N]; impulse: of all of them [N·s]. point: the latest.
    """

    peak: float = 0.0
    impulse: float = 0.0
    point: _Point | None = None

    def add(self, force: float, seconds: float, point: _Point | None = None) -> None:
        self.peak = max(self.peak, force)
        self.impulse += force * seconds
        self.point = point


class ContactSensor(Remembers):
    """Reads the engine's contacts, summed for each pair of links.

    An impact is over within a substep, and two links may have parted when they are read: what they
    bore is summed up in every substep.

    row: which links, and how far it measures. errors: of distances; seed: of the plant.
    """

    remembers, parts = ("_loads",), ("_skins",)
    _loads: dict[Pair, _Load]

    def __init__(
        self,
        name: str,
        row: ContactSensorSettings,
        physics: Physics,
        errors: ProximityErrors,
        seed: int,
    ) -> None:
        self._engine = engine = physics.engine
        links, indices, within = _expanded(row.links, physics), physics.links, row.within
        self.description = Description(names=links)
        self._names = {index: name for name, index in indices.items()}
        self._watched = {indices[link] for link in links}
        # Query by body: where items stand on shelves, most contacts are theirs.
        watches_all = len(self._watched) == len(self._names)
        self._bodies = None if watches_all else sorted({body for body, _ in self._watched})
        self._within = within
        solid = (link for link in links if engine.is_solid(indices[link]))
        self._near = [indices[link] for link in solid] if within > 0.0 else []
        self._pressed: dict[Pair, float] | None = None
        self._loads = {}
        self._skins: list[Skin] = []
        self._stands: set[tuple[Link, Link]] = set()
        if (errors.gain or errors.noise) and self._near:
            self._skins = [Skin(links, errors, Noise(seed, "proximity", name))]
            engine.update_shapes()
            # What the robot stands on is nothing new to the links that are near it.
            closest = engine.closest
            ground = {row.other for link in self._near for row in closest(link, _STANDS_ON)}
            near = ((link, row.other) for link in self._near for row in closest(link, within))
            self._stands = {(link, other) for link, other in near if other in ground}

    def after_substep(self, seconds: float) -> None:
        """Add up what presses on the watched links; seconds: length of the substep."""
        pressed = map(self._point, self._touching(are_pressed=True))
        for pair, points in _by_pair(pressed).items():
            force = sum(point.force for point in points)
            self._loads.setdefault(pair, _Load()).add(force, seconds, _nearest(points))

    def sense(self, _t_ns: int) -> Contacts:
        """Return the contacts of the watched links.

        Forces are those of the latest physics substep, which led to this state; links that touched
        only in an earlier one are where they were then. Peaks and impulses are those of all
        substeps since the latest reading.
        """
        loads, self._loads = self._loads, {}
        points = list(map(self._point, self._touching()))
        if not self._skins:
            points += [point for _, point in self._nearby()]
        for skin in self._skins:
            # It feels what presses on it; how far away the rest is, it measures.
            points = [point for point in points if self._force(point.pair, [point]) > 0.0]
            points += self._measured(skin)
        known = {point.pair for point in points}
        parted = [load.point for pair, load in loads.items() if load.point and pair not in known]
        points += [point._replace(force=0.0) for point in parted]
        groups = _by_pair(points)
        pairs = sorted(groups)
        nearest = [_nearest(groups[pair]) for pair in pairs]
        return Contacts(
            pairs=pairs,
            force=[self._force(pair, groups[pair]) for pair in pairs],
            distance=[point.distance for point in nearest],
            position=[point.position for point in nearest],
            peak_force=[loads.get(pair, _NOTHING).peak for pair in pairs],
            impulse=[loads.get(pair, _NOTHING).impulse for pair in pairs],
        )

    def _touching(self, *, are_pressed: bool = False) -> list[Contact]:
        if self._bodies is None:
            return self._engine.contacts(are_pressed=are_pressed)
        watched, touching = self._watched, []
        for body in self._bodies:
            for contact in self._engine.contacts(body, are_pressed=are_pressed):
                other = contact.other
                # Those of two watched bodies are reported of the first one.
                if other[0] >= body if other in watched else contact.one in watched:
                    touching.append(contact)
        return touching

    def _nearby(self) -> Iterator[tuple[Link, _Point]]:
        """Yield links farther apart than about 1 mm, which are not among the engine's contacts.

        Each with the watched link whose neighbour it is.
        """
        for link in self._near:
            for contact in self._engine.closest(link, self._within):
                if (link, contact.other) not in self._stands:
                    yield link, self._point(contact)

    def _measured(self, skin: Skin) -> Iterator[_Point]:
        """Yield what the skin measures: the nearest point of each link that is near another."""
        nearest: dict[Pair, _Point] = {}
        owners: dict[Pair, str] = {}
        for link, point in self._nearby():
            owners.setdefault(point.pair, self._names[link])
            if point.distance < nearest.setdefault(point.pair, point).distance:
                nearest[point.pair] = point
        points = list(nearest.values())
        distances = skin.measure(list(owners.values()), [point.distance for point in points])
        for point, distance in zip(points, distances, strict=True):
            yield point._replace(distance=distance, force=0.0)

    def _point(self, contact: Contact) -> _Point:
        one, other = self._names[contact.one], self._names[contact.other]
        pair, at = (
            ((other, one), contact.on_one) if other < one else ((one, other), contact.on_other)
        )
        return _Point(pair, contact.distance, contact.force, at)

    def press(self, forces: Mapping[tuple[Link, Link], float], seconds: float) -> None:
        """Report these forces [N], and no others: the engine computes none; seconds: how long."""
        self._pressed = {}
        for (link, other), force in forces.items():
            one, two = sorted((self._names[link], self._names[other]))
            self._pressed[one, two] = force
            self._loads.setdefault((one, two), _Load()).add(force, seconds)

    def _force(self, pair: Pair, points: Sequence[_Point]) -> float:
        if self._pressed is not None:
            return self._pressed.get(pair, 0.0)
        return sum(point.force for point in points)


_NOTHING = _Load()


def _by_pair(points: Iterable[_Point]) -> dict[Pair, list[_Point]]:
    """Return the points of each pair."""
    groups: dict[Pair, list[_Point]] = {}
    for point in points:
        groups.setdefault(point.pair, []).append(point)
    return groups


def _nearest(points: Iterable[_Point]) -> _Point:
    return min(points, key=lambda point: point.distance)


def _expanded(links: Sequence[str] | None, physics: Physics) -> list[str]:
    """Return links without duplicates, with `<body>/*` expanded to all links of a body.

    links: None: all.
    """
    if links is None:
        return list(physics.links)
    every = {
        f"{body}/*": [name for name, link in physics.links.items() if link[0] == number]
        for number, body in enumerate(physics.bodies)
    }
    return list(dict.fromkeys(name for link in links for name in every.get(link, [link])))
