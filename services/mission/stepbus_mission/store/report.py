"""The report about all sales, as a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

_HEADER = ("sale", "item", "attempts", "detection", "place", "others", "duration")


@dataclass(frozen=True, kw_only=True)
class SaleResult:
    """The result of a sale.

    attempts: to grasp the item. detection_error: of the last detection [m]. place_error: of the
    item's position in the outlet [m]. moved: largest displacement of another item [m]. duration:
    of the sale [s].
    """

    number: int
    item: str
    attempts: int
    detection_error: float
    place_error: float
    moved: float
    duration: float

    def cells(self) -> tuple[str, ...]:
        """Return the values as text, in the order of the table's header."""
        return (
            str(self.number),
            self.item,
            str(self.attempts),
            f"{self.detection_error * 1e3:.1f} mm",
            f"{self.place_error * 1e3:.1f} mm",
            f"{self.moved * 1e3:.1f} mm",
            f"{self.duration:.1f} s",
        )


def table(results: Sequence[SaleResult]) -> str:
    """Return the sales as lines of aligned columns below a header."""
    lines = [_HEADER, *(result.cells() for result in results)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def summary(results: Sequence[SaleResult], orders: int, duration: float, failure: str = "") -> str:
    """Return the table and a summary line.

    orders: number of orders. duration: of the mission [s]. failure: why it ended early.
    """
    last = f"{len(results)} of {orders} sales in {duration:.1f} s"
    if results:
        place = max(result.place_error for result in results) * 1e3
        moved = max(result.moved for result in results) * 1e3
        last += f"; placed within {place:.1f} mm, other items moved up to {moved:.1f} mm"
    parts = [table(results), last] if results else [last]
    return "\n".join([*parts, failure] if failure else parts)
