"""What became of the sales, for people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

_HEADER = ("sale", "item", "attempts", "detection", "place", "others", "duration")


@dataclass(frozen=True, kw_only=True)
class Row:
    """One sale: how often the item was grasped for, and how far things were off.

    detection_error: of the last detection from the truth [m]; place_error: of the item from its
    spot in the outlet [m]; moved: largest displacement of another item [m]; duration [s].
    """

    number: int
    item: str
    attempts: int
    detection_error: float
    place_error: float
    moved: float
    duration: float

    def cells(self) -> tuple[str, ...]:
        """Return the row as text, in the order of the table's header."""
        return (
            str(self.number),
            self.item,
            str(self.attempts),
            f"{self.detection_error * 1e3:.1f} mm",
            f"{self.place_error * 1e3:.1f} mm",
            f"{self.moved * 1e3:.1f} mm",
            f"{self.duration:.1f} s",
        )


def table(rows: Sequence[Row]) -> str:
    """Return the sales as lines of aligned columns, under a header."""
    lines = [_HEADER, *(row.cells() for row in rows)]
    widths = [max(len(line[at]) for line in lines) for at in range(len(_HEADER))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def summary(rows: Sequence[Row], orders: int, duration: float, failure: str = "") -> str:
    """Return the table and a last line.

    orders: how many there were. duration: of all of it [s]. failure: why it ended early.
    """
    last = f"{len(rows)} of {orders} sales in {duration:.1f} s"
    if rows:
        place = max(row.place_error for row in rows) * 1e3
        moved = max(row.moved for row in rows) * 1e3
        last += f"; placed within {place:.1f} mm, other items moved up to {moved:.1f} mm"
    parts = [table(rows), last] if rows else [last]
    return "\n".join([*parts, failure] if failure else parts)
