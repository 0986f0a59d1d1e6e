"""Which links touch, how hard, and how close the nearly touching ones are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import pybullet as bullet

from stepbus_schemas import Contacts, Description

from .poses import Place


class _Point(NamedTuple):
    """A point where two links touch or nearly do; position: on the second link."""

    pair: tuple[str, str]
    distance: float
    force: float
    position: tuple[float, float, float]


class ContactSensor:
    """Reads the engine's contacts, summed up for each pair of links.

    links: those whose contacts it shows; None: all. within: it also shows what is this near to
    them [m]. places: every link of the world → where it is in the engine.
    """

    def __init__(
        self,
        links: Sequence[str] | None,
        within: float,
        places: Mapping[str, Place],
        client: int,
    ) -> None:
        self._client = client
        self._links = list(places if links is None else links)
        self._names = {place: name for name, place in places.items()}
        self._watched = {places[link] for link in self._links}
        self._bodies = sorted({body for body, _ in self._watched})
        self._all = len(self._watched) == len(places)
        self._within = within
        solid = [at for at in map(places.__getitem__, self._links) if self._is_solid(at)]
        self._near = solid if within > 0.0 else []

    def _is_solid(self, place: Place) -> bool:
        return bool(bullet.getCollisionShapeData(*place, physicsClientId=self._client))

    def describe(self) -> Description:
        """Return the names of the links whose contacts it shows."""
        return Description(names=self._links)

    def sense(self) -> Contacts:
        """Return the contacts of the watched links.

        Forces are those of the newest physics substep, which are those that led to this state.
        """
        groups: dict[tuple[str, str], list[_Point]] = {}
        for point in (*self._touching(), *self._nearby()):
            groups.setdefault(point.pair, []).append(point)
        pairs = sorted(groups)
        nearest = [min(groups[pair], key=lambda point: point.distance) for pair in pairs]
        return Contacts(
            pairs=pairs,
            force=[sum(point.force for point in groups[pair]) for pair in pairs],
            distance=[point.distance for point in nearest],
            position=[point.position for point in nearest],
        )

    def _touching(self) -> Iterator[_Point]:
        if self._all:
            yield from map(self._point, bullet.getContactPoints(physicsClientId=self._client))
            return
        # By body: in a store, the items on their shelves have most of the contacts.
        for body in self._bodies:
            for row in bullet.getContactPoints(body, physicsClientId=self._client):
                other = row[2], row[4]
                told_before = other in self._watched and other[0] < body
                if not told_before and ((body, row[3]) in self._watched or other in self._watched):
                    yield self._point(row)

    def _nearby(self) -> Iterator[_Point]:
        """Yield what the engine's own contacts do not see: it looks no further than about 1 mm."""
        for place in self._near:
            for other in self._around(place):
                rows = bullet.getClosestPoints(
                    place[0],
                    other[0],
                    self._within,
                    place[1],
                    other[1],
                    physicsClientId=self._client,
                )
                yield from map(self._point, rows)

    def _around(self, place: Place) -> list[Place]:
        """Return links of other bodies whose boxes are near that of a link, in a fixed order.

        The engine's boxes are as old as the last physics substep, and 20 mm larger than what is in
        them (gContactBreakingThreshold), which is more than a link moves in a substep.
        """
        low, high = bullet.getAABB(*place, self._client)
        found = bullet.getOverlappingObjects(
            [x - self._within for x in low],
            [x + self._within for x in high],
            physicsClientId=self._client,
        )
        return sorted({(other, link) for other, link in found or () if other != place[0]})

    def _point(self, row: Sequence[Any]) -> _Point:
        first, second = self._names[row[1], row[3]], self._names[row[2], row[4]]
        if second < first:
            return _Point((second, first), row[8], row[9], row[5])
        return _Point((first, second), row[8], row[9], row[6])


def name_links(
    links: Sequence[str], places: Mapping[str, Place], bodies: Sequence[str]
) -> list[str]:
    """Return the links that are meant, each once; `<body>/*` means all links of a body.

    What is unknown stays as it is.
    """
    every = {
        f"{body}/*": [name for name, place in places.items() if place[0] == number]
        for number, body in enumerate(bodies)
    }
    return list(dict.fromkeys(name for link in links for name in every.get(link, [link])))
