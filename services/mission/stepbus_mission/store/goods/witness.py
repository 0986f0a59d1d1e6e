"""Who moved an item: the robot, or somebody else."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from stepbus_mission.store.geometry import distance
from stepbus_schemas import Contacts, Point, Poses

from .stock import Stock

_FASTEST = 1.0
"""The robot moves nothing faster than this [m/s]."""

_NEAR = 0.25
"""How near to its tip, or to what it carries, the robot may have moved an item unfelt [m]."""

_STILL = 1e-4
"""Displacement between two samples below which an item has come to rest [m]."""


@dataclass(frozen=True, kw_only=True)
class Moved:
    """An item that somebody else moves; distance: from where it stood [m]."""

    item: str
    distance: float


class Witness:
    """Watches all items, from the inventory on.

    An item is moved by the robot if, when it starts to move, the robot has touched it, or something
    that the robot moves is near. It is moved by others if nothing is near, or if it jumps.

    tolerance: displacement from which an item counts as moved [m].
    """

    def __init__(self, stock: Stock, poses: Poses, tolerance: float) -> None:
        self._stock = stock
        self._tolerance = tolerance
        self._rest = {name: stock.pose(name, poses)[0] for name in stock.names}
        self._last = dict(self._rest)
        self._touched: set[str] = set()
        self._by_robot: dict[str, bool] = {}
        self._at = 0.0

    def feel(self, contacts: Contacts, links: Collection[str]) -> None:
        """Record which items the robot presses on; links: of the robot."""
        for pair, force in zip(contacts.pairs, contacts.force, strict=True):
            if force > 0.0 and not set(links).isdisjoint(pair):
                self._touched.update(name for name in pair if name in self._rest)

    def watch(self, poses: Poses, t: float, near: Sequence[Point], besides: str) -> list[Moved]:
        """Compare with the poses at a time [s]; return items that others have started to move.

        near: where the robot is. besides: the item that the robot moves on purpose.
        """
        farthest, self._at = _FASTEST * (t - self._at), t
        found = []
        for name, rest in self._rest.items():
            now, before = self._stock.pose(name, poses)[0], self._last[name]
            self._last[name] = now
            if name == besides:
                continue
            if now != before and self._starts(name, now):
                jumps = distance(before, now) > farthest
                self._by_robot[name] = not jumps and self._is_robot(name, near)
                if not self._by_robot[name]:
                    found.append(Moved(item=name, distance=distance(rest, now)))
            elif self._by_robot.get(name) is False and distance(before, now) < _STILL:
                self.settle(name, poses)
        return found

    def _starts(self, name: str, now: Point) -> bool:
        return name not in self._by_robot and distance(self._rest[name], now) > self._tolerance

    def _is_robot(self, name: str, near: Sequence[Point]) -> bool:
        pushed = [self._rest[other] for other, robot in self._by_robot.items() if robot]
        near_it = (distance(self._rest[name], at) < _NEAR for at in (*near, *pushed))
        return name in self._touched or any(near_it)

    def settle(self, name: str, poses: Poses) -> None:
        """Take where an item is now for where it belongs."""
        self._rest[name] = self._last[name] = self._stock.pose(name, poses)[0]
        self._by_robot.pop(name, None)
        self._touched.discard(name)

    def largest(self, poses: Poses, besides: str) -> tuple[float, str]:
        """Return how far the robot has moved an item that it should not [m], and its name.

        besides: the item that it is meant to move. An empty name: there is no other item.
        """
        moves = (
            (distance(rest, self._stock.pose(name, poses)[0]), name)
            for name, rest in self._rest.items()
            if name != besides and self._by_robot.get(name, True)
        )
        return max(moves, key=lambda move: move[0], default=(0.0, ""))
