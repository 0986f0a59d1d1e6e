"""The report about all sales, as a table."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

WITNESSES = {"camera": " by the camera", "truth": " by the true poses"}
"""Who verifies a sale → a phrase for the summary."""

_HEADER = ("sale", "item", "attempts", "detection", "place", "others", "duration")


@dataclass(frozen=True, kw_only=True)
class SaleResult:
    """The result of a sale.

    attempts: to grasp the item. detection_error: of the last detection [m]. place_error: of the
    item's position in the outlet [m]. moved: largest displacement of another item [m]. None:
    unknown. duration: of the sale [s].
    """

    number: int
    item: str
    attempts: int
    detection_error: float | None
    place_error: float
    moved: float | None
    duration: float

    def cells(self) -> tuple[str, ...]:
        """Return the values as text, in the order of the table's header."""
        return (
            str(self.number),
            self.item,
            str(self.attempts),
            *(
                "-" if value is None else f"{value * 1e3:.1f} mm"
                for value in (self.detection_error, self.place_error, self.moved)
            ),
            f"{self.duration:.1f} s",
        )


@dataclass(frozen=True, kw_only=True)
class Unsold:
    """An order that was not fulfilled; reason: a phrase."""

    number: int
    order: str
    reason: str


def _table(results: Sequence[SaleResult], unsold: Sequence[Unsold]) -> str:
    """Return one line for each order, in columns below a header."""
    sold = {result.number: result.cells() for result in results}
    rest = {row.number: (str(row.number), row.order, f"not sold: {row.reason}") for row in unsold}
    # The reason of an order that was not fulfilled does not widen the columns.
    lines = [_HEADER, *sold.values(), *((*row[:2], "") for row in rest.values())]
    widths = [max(map(len, column)) for column in zip_longest(*lines, fillvalue="")]
    rows = [_HEADER, *(row for _, row in sorted({**sold, **rest}.items()))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=False)).rstrip()
        for row in rows
    )


def summary(
    results: Sequence[SaleResult],
    orders: int,
    duration: float,
    *,
    failure: str,
    unsold: Sequence[Unsold],
    by: str,
) -> str:
    """Return the table and a summary line.

    orders: number of orders. duration: of the mission [s]. failure: why it ended early. by: of
    `WITNESSES`: what has measured all this.
    """
    last = f"{len(results)} of {orders} sales in {duration:.1f} s"
    if results:
        place = max(result.place_error for result in results) * 1e3
        last += f"; placed within {place:.1f} mm{by}"
        moved = [result.moved for result in results if result.moved is not None]
        if moved:
            last += f", other items moved up to {max(moved) * 1e3:.1f} mm"
    parts = [_table(results, unsold), last] if results or unsold else [last]
    return "\n".join([*parts, failure] if failure else parts)
