"""What a script draws: points and lines, as a message."""

from dataclasses import dataclass
from typing import Any

from stepbus_coppelia.clients import ApiError
from stepbus_coppelia.functions.table import number, numbers, point
from stepbus_schemas import Point

FIRST = 2_280_010
"""Their handles begin here."""
_KINDS = {1: "lines", 2: "triangles", 3: "triangles", 8: "strip"}
_COUNTS = {"lines": 2, "triangles": 3}
"""Points of an item."""
_MOST_POINTS = 1000
"""Of all objects, which go into one message; then the oldest of an object go."""
_ALL, _CYCLIC, _FORM = -2, 4096, 31


@dataclass
class _Drawing:
    form: str
    frame: str
    size: float
    colour: Point
    points: list[Point]
    most: int
    is_cyclic: bool


class Canvas:
    """All drawing objects. is_new: whether they have changed since the last message."""

    def __init__(self) -> None:
        self._objects: dict[int, _Drawing] = {}
        self._next = FIRST
        self.is_new = True  # the first message of a simulation says that there is none

    def add(self, form: int, size: float, frame: str, most: int, colour: list[float] | None) -> int:
        """Add an object of one form, in the frame of a link or of the world; return its handle.

        size: [m], of lines [pixel]. most: items; 0: any number. colour: red, green, blue.
        """
        handle, self._next = self._next, self._next + 1
        kind, rgb = _KINDS.get(form & _FORM, "points"), point((colour or [0.0, 0.0, 0.0])[:3])
        is_cyclic = bool(form & _CYCLIC)
        self._objects[handle] = _Drawing(kind, frame, number(size), rgb, [], most, is_cyclic)
        self.is_new = True
        return handle

    def draw(self, handle: int, item: object) -> None:
        """Add an item to an object; None: remove all of them."""
        if (drawing := self._objects.get(handle)) is None:
            raise ApiError("drawing object does not exist.")
        points, count, self.is_new = drawing.points, _COUNTS.get(drawing.form, 1), True
        if item is None:
            points.clear()
            return
        given = numbers(item)
        if len(given) < 3 * count:
            raise ApiError(f"an item of this drawing object has {3 * count} numbers.")
        if drawing.most and len(points) >= drawing.most * count:
            if not drawing.is_cyclic:
                return
            del points[:count]
        if sum(len(row.points) for row in self._objects.values()) > _MOST_POINTS:
            del points[:count]
        points += [(given[n], given[n + 1], given[n + 2]) for n in range(0, 3 * count, 3)]

    def remove(self, handle: int) -> None:
        """Remove an object."""
        if handle == _ALL:
            self._objects.clear()
        elif self._objects.pop(handle, None) is None:
            raise ApiError("drawing object does not exist.")
        self.is_new = True

    def fields(self) -> dict[str, Any]:
        """Return all of them as the fields of a `Drawings`; empty: nothing has changed."""
        if not self.is_new:
            return {}
        self.is_new, rows = False, list(self._objects.values())
        heads = [(o.form, o.size, *o.colour, len(o.points), o.frame) for o in rows]
        points = [at for row in rows for at in row.points]
        return {"objects": [" ".join(map(str, head)) for head in heads], "points": points}
