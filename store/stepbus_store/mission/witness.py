"""Who moved an item: the robot, or another body; and what has struck the robot."""

import math
from collections.abc import Collection, Mapping

from stepbus_schemas import Contacts, Point, Poses
from stepbus_store.mission.inventory import Measures, Stock

_FASTEST = 1.0
"""The robot moves nothing faster than this [m/s]."""

_GAP = 5e-3
"""How near what the robot moves may have come to an item without a sample that shows it [m]."""

_FELT_FOR = 0.5
"""How long an item that the robot has touched may start to move for that [s]."""

_BLOW, _BLAMED_FOR = 50.0, 3.0
"""More than any touch of a sale [N], and how long later it may be why that fails [s]."""

_STILL = 1e-4
"""Displacement between two samples below which an item has come to rest [m]."""


class Blows:
    """Remembers the hardest of the latest blows on the robot; links: of it."""

    def __init__(self, links: frozenset[str]) -> None:
        self._links = self._known = links
        self._at, self._force, self._text = -math.inf, 0.0, ""

    def feel(self, contacts: Contacts, t: float) -> None:
        """Look for a blow at a time [s]; what the robot stands on at first is the ground."""
        if self._known == self._links:
            near = zip(contacts.pairs, contacts.distance, strict=True)
            self._known |= {link for pair, gap in near if gap < _GAP for link in pair}
        for pair, force in zip(contacts.pairs, contacts.peaks, strict=True):
            one, other = pair if pair[0] in self._links else pair[::-1]
            is_hard = force > _BLOW and (force > self._force or not self.text(t))
            if is_hard and other not in self._known:
                self._at, self._force = t, force
                self._text = f"at {t:.2f} s, {one} touches {other} with {force:.1f} N"

    def text(self, t: float) -> str:
        """Return a sentence on what a failure at a time [s] may come from; empty: nothing."""
        return self._text if t - self._at <= _BLAMED_FOR else ""


class Witness:
    """Watches all items, from the inventory on.

    An item is moved by the robot if, when it starts to move, the robot has just touched it, or if
    something that the robot moves, which may be another item, comes as near as to push it. It is
    moved by others if it does not, or if it jumps. Without `watch`, the robot has moved them all.

    tolerance: displacement from which an item counts as moved [m].
    """

    def __init__(self, stock: Stock, poses: Poses, tolerance: float) -> None:
        self._stock, self._measures = stock, stock.measures
        self._tolerance = tolerance
        self._rest = {name: stock.pose(name, poses)[0] for name in stock.measures}
        self._last = dict(self._rest)
        self._felt: dict[str, float] = {}
        self._by_robot: dict[str, bool] = {}
        self._at = 0.0

    def feel(self, contacts: Contacts, links: Collection[str], t: float) -> None:
        """Record which items the robot touches at a time [s]; links: of the robot."""
        rows = zip(contacts.pairs, contacts.peaks, contacts.distance, strict=True)
        for pair, force, gap in rows:
            if (force > 0.0 or gap < _GAP) and not set(links).isdisjoint(pair):
                self._felt.update((name, t) for name in pair if name in self._rest)

    def watch(self, poses: Poses, t: float, besides: str) -> list[tuple[str, float]]:
        """Compare with the poses at a time [s]; return items that others have started to move.

        Returns their names, and how far each has moved [m]. besides: the item that the robot moves
        on purpose.
        """
        farthest, self._at = _FASTEST * (t - self._at), t
        where = {name: self._stock.pose(name, poses)[0] for name in self._rest}
        moves = {n: now for n, now in where.items() if now != self._last[n]}
        starts = [n for n, now in moves.items() if n != besides and self._starts(n, now)]
        jumps = {n for n in starts if math.dist(self._last[n], moves[n]) > farthest}
        self._by_robot |= dict.fromkeys(starts, False)
        self._by_robot |= {n: True for n in starts if n not in jumps and self._is_felt(n)}
        while pushed := [
            n for n in starts if n not in jumps and self._is_pushed(n, moves, besides)
        ]:
            self._by_robot |= dict.fromkeys(pushed, True)
        for name, now in where.items():
            before, self._last[name] = self._last[name], now
            is_known = self._by_robot.get(name) is False and name not in starts
            if is_known and math.dist(before, now) < _STILL:
                self.settle(name, poses)
        by_others = [name for name in starts if not self._by_robot[name]]
        return [(name, math.dist(self._rest[name], where[name])) for name in by_others]

    def _starts(self, name: str, now: Point) -> bool:
        return name not in self._by_robot and math.dist(self._rest[name], now) > self._tolerance

    def _is_felt(self, name: str) -> bool:
        return name in self._felt and self._at - self._felt[name] <= _FELT_FOR

    def _is_pushed(self, name: str, moves: Mapping[str, Point], besides: str) -> bool:
        """Return whether an item that the robot moves has newly come as near as to push this one.

        moves: of the items, since the last time.
        """
        pushers = (n for n in moves if n != name and (n == besides or self._by_robot.get(n)))
        return not self._by_robot[name] and any(
            self._gap(name, n, moves[n]) < math.dist(self._last[n], moves[n]) + _GAP
            for n in pushers
        )

    def _gap(self, name: str, other: str, now: Point) -> float:
        """Return how far apart an item, where it stood, and another one are, as round as wide."""
        one, two, there = self._measures[name], self._measures[other], self._rest[name]
        apart = math.hypot(there[0] - now[0], there[1] - now[1]) - _radius(one) - _radius(two)
        below = there[2] + one.bottom - (now[2] + two.top)
        above = now[2] + two.bottom - (there[2] + one.top)
        return max(apart, below, above, 0.0)

    def settle(self, name: str, poses: Poses) -> None:
        """Take where an item is now for where it belongs."""
        self._rest[name] = self._last[name] = self._stock.pose(name, poses)[0]
        self._by_robot.pop(name, None)
        self._felt.pop(name, None)

    def largest(self, poses: Poses, besides: str) -> tuple[float, str]:
        """Return how far the robot has moved an item that it should not [m], and its name.

        besides: the item that it is meant to move. An empty name: there is no other item.
        """
        moves = (
            (math.dist(rest, self._stock.pose(name, poses)[0]), name)
            for name, rest in self._rest.items()
            if name != besides and self._by_robot.get(name, True)
        )
        return max(moves, key=lambda move: move[0], default=(0.0, ""))


def _radius(of: Measures) -> float:
    """Return the radius of a circle around an item, as seen from above [m]."""
    return (math.hypot(*of.width) if of.is_box else max(of.width)) / 2
