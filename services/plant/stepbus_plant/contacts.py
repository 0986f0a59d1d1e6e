"""A skin of capacitive sensors on the links of a robot: how far away it measures things."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import pybullet as bullet

from stepbus_plant.params import ProximityErrors
from stepbus_plant.poses import LinkIndex
from stepbus_plant.readings import Noise
from stepbus_schemas import Contacts, Description

_CALIBRATION = 0
"""Number of the reading that draws what stays the same during a run; the others count from 1."""


class Skin:
    """Electrodes all over some links: each measures the nearest surface, wherever that is.

    links: those with a skin. errors: of its distances. random: numbers for that.
    """

    def __init__(self, links: Sequence[str], errors: ProximityErrors, random: Noise) -> None:
        self._noise, self._random = errors.noise, random
        gains = random.at(_CALIBRATION).normal(1.0, errors.gain, len(links)).tolist()
        self._gains: dict[str, float] = dict(zip(links, gains, strict=True))
        self._readings = _CALIBRATION

    def measure(self, links: Sequence[str], distances: Sequence[float]) -> list[float]:
        """Return what the skins of some links measure of these distances in a step [m], ≥ 0."""
        self._readings += 1
        if not links:
            return []
        noise = self._random.at(self._readings).normal(1.0, self._noise, len(links)).tolist()
        return [
            max(distance * self._gains[link] * factor, 0.0)
            for link, distance, factor in zip(links, distances, noise, strict=True)
        ]


_EXACT = ProximityErrors()
_STANDS_ON = 2e-3
"""What a robot is closer to at the start, it stands on [m]."""


class _Point(NamedTuple):
    """A point where two links touch or nearly touch; position: on the second link."""

    pair: tuple[str, str]
    distance: float
    force: float
    position: tuple[float, float, float]


class ContactSensor:
    """Reads the engine's contacts, summed for each pair of links.

    links: those whose contacts it reports; None: all. within: it also reports links closer to them
    than this [m]. indices: every link of the world → its index in the engine. errors: of distances;
    random: numbers for that.
    """

    def __init__(
        self,
        links: Sequence[str] | None,
        within: float,
        indices: Mapping[str, LinkIndex],
        client: int,
        *,
        errors: ProximityErrors = _EXACT,
        random: Noise | None = None,
    ) -> None:
        self._client = client
        self._links = list(indices if links is None else links)
        self._names = {index: name for name, index in indices.items()}
        self._watched = {indices[link] for link in self._links}
        self._bodies = sorted({body for body, _ in self._watched})
        self._all = len(self._watched) == len(indices)
        self._within = within
        solid = [index for link in self._links if self._is_solid(index := indices[link])]
        self._near = solid if within > 0.0 else []
        self._pressed: dict[tuple[str, str], float] | None = None
        self._stands: set[tuple[LinkIndex, LinkIndex]] = set()
        self._skin: Skin | None = None
        if (errors.gain or errors.noise) and self._near:
            self._skin = Skin(self._links, errors, random or Noise(0, "proximity"))
            # Before the first step, the engine's bounding boxes are those of loading.
            bullet.performCollisionDetection(client)
            self._stands = self._ground()

    def _is_solid(self, index: LinkIndex) -> bool:
        return bool(bullet.getCollisionShapeData(*index, physicsClientId=self._client))

    def describe(self) -> Description:
        """Return the names of the links whose contacts it reports."""
        return Description(names=self._links)

    def sense(self) -> Contacts:
        """Return the contacts of the watched links.

        Forces are those of the latest physics substep, which led to this state.
        """
        groups: dict[tuple[str, str], list[_Point]] = {}
        if self._skin is None:
            points = [*self._touching(), *(point for _, point in self._nearby())]
        else:
            # The skin feels what presses on it; how far away the rest is, it measures.
            felt = [point for point in self._touching() if self._force(point.pair, [point]) > 0.0]
            points = [*felt, *self._measured(self._skin)]
        for point in points:
            groups.setdefault(point.pair, []).append(point)
        pairs = sorted(groups)
        nearest = [min(groups[pair], key=lambda point: point.distance) for pair in pairs]
        return Contacts(
            pairs=pairs,
            force=[self._force(pair, groups[pair]) for pair in pairs],
            distance=[point.distance for point in nearest],
            position=[point.position for point in nearest],
        )

    def _touching(self) -> Iterator[_Point]:
        if self._all:
            yield from map(self._point, bullet.getContactPoints(physicsClientId=self._client))
            return
        # Query by body: in a store, most contacts are those of items on shelves.
        for body in self._bodies:
            for row in bullet.getContactPoints(body, physicsClientId=self._client):
                other = row[2], row[4]
                reported = other in self._watched and other[0] < body
                if not reported and ((body, row[3]) in self._watched or other in self._watched):
                    yield self._point(row)

    def _nearby(self) -> Iterator[tuple[LinkIndex, _Point]]:
        """Yield links farther apart than about 1 mm, which are not among the engine's contacts.

        Each with the watched link whose neighbour it is.
        """
        for index in self._near:
            for other in self._around(index):
                if (index, other) in self._stands:
                    continue
                rows = bullet.getClosestPoints(
                    index[0],
                    other[0],
                    self._within,
                    index[1],
                    other[1],
                    physicsClientId=self._client,
                )
                yield from ((index, self._point(row)) for row in rows)

    def _ground(self) -> set[tuple[LinkIndex, LinkIndex]]:
        """Return what the robot stands on, for the links that are near it: that is nothing new."""
        near = {(index, other) for index in self._near for other in self._around(index)}
        ground = {
            other
            for index, other in near
            if bullet.getClosestPoints(
                index[0], other[0], _STANDS_ON, index[1], other[1], physicsClientId=self._client
            )
        }
        return {(index, other) for index, other in near if other in ground}

    def _measured(self, skin: Skin) -> Iterator[_Point]:
        """Yield what the skin measures: the nearest point of each link that is near another."""
        nearest: dict[tuple[str, str], _Point] = {}
        owners: dict[tuple[str, str], str] = {}
        for index, point in self._nearby():
            known = nearest.setdefault(point.pair, point)
            owners.setdefault(point.pair, self._names[index])
            if point.distance < known.distance:
                nearest[point.pair] = point
        points = list(nearest.values())
        distances = skin.measure(list(owners.values()), [point.distance for point in points])
        for point, distance in zip(points, distances, strict=True):
            yield point._replace(distance=distance, force=0.0)

    def _around(self, index: LinkIndex) -> list[LinkIndex]:
        """Return links of other bodies whose bounding boxes are near that of a link, sorted.

        The boxes are those of the latest physics substep. The engine makes them 20 mm larger than
        the link (gContactBreakingThreshold), which is more than it moves in a substep.
        """
        low, high = bullet.getAABB(*index, self._client)
        pairs = bullet.getOverlappingObjects(
            [x - self._within for x in low],
            [x + self._within for x in high],
            physicsClientId=self._client,
        )
        return sorted({(other, link) for other, link in pairs or () if other != index[0]})

    def _point(self, row: Sequence[Any]) -> _Point:
        first, second = self._names[row[1], row[3]], self._names[row[2], row[4]]
        if second < first:
            return _Point((second, first), row[8], row[9], row[5])
        return _Point((first, second), row[8], row[9], row[6])

    def press(self, forces: Mapping[tuple[LinkIndex, LinkIndex], float]) -> None:
        """Report these forces [N], and no others: the engine computes none."""
        named = {
            tuple(sorted((self._names[one], self._names[other]))): force
            for (one, other), force in forces.items()
        }
        self._pressed = {(pair[0], pair[1]): force for pair, force in named.items()}

    def _force(self, pair: tuple[str, str], points: Sequence[_Point]) -> float:
        if self._pressed is not None:
            return self._pressed.get(pair, 0.0)
        return sum(point.force for point in points)


def name_links(
    links: Sequence[str], indices: Mapping[str, LinkIndex], bodies: Sequence[str]
) -> list[str]:
    """Return the links without duplicates, with `<body>/*` expanded to all links of a body.

    Unknown names stay as they are.
    """
    every = {
        f"{body}/*": [name for name, index in indices.items() if index[0] == number]
        for number, body in enumerate(bodies)
    }
    return list(dict.fromkeys(name for link in links for name in every.get(link, [link])))
