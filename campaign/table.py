"""The tables that the campaign prints, in Markdown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

Column = Callable[[Sequence[Any]], object]
"""Makes a cell of what all cases of a row have there."""


def codes(values: Sequence[int | None]) -> str:
    """Return exit codes, without that of a run that hangs."""
    return ", ".join(str(code) for code in sorted({*values} - {None}))  # type: ignore[type-var]


def most(values: Sequence[float]) -> str:
    """Return the largest value."""
    return f"{max(values):.1f}"


RUNS: Mapping[str, Column] = {
    "Cases": sum, "Missed": sum, "Exit codes": codes, "Slowest end [s]": most, "Broken": sum,
}  # fmt: skip
"""Cases: those in which the fault struck. Missed: those whose run had ended before."""

SALES: Mapping[str, Column] = {
    "Cases": len, "Sold": sum, "Stopped": sum, "Largest force [N]": most, "Too near": sum,
    "Broken": sum,
}  # fmt: skip
"""Too near: sales in which something appeared nearer than the robot can stop."""


class Table:
    """What the cases came to, a row for each thing that happens; the last column: broken promises.

    columns: title → what makes its cells.
    """

    def __init__(self, columns: Mapping[str, Column]) -> None:
        self._columns = columns
        self._rows: dict[str, list[Sequence[Any]]] = {}
        self.broken = 0

    def add(self, name: str, *values: Any) -> None:
        """Count one case: a value for each column."""
        self._rows.setdefault(name, []).append(values)
        self.broken += values[-1]

    def lines(self) -> list[str]:
        """Return the table; empty without a case."""
        if not self._rows:
            return []
        every = [case for cases in self._rows.values() for case in cases]
        rows = [self._row(name, cases) for name, cases in sorted(self._rows.items())]
        heads = ["What happens", *self._columns]
        table = [heads, ["---"] * len(heads), *rows, self._row("**all**", every)]
        return [f"| {' | '.join(row)} |" for row in table]

    def _row(self, name: str, cases: Sequence[Sequence[Any]]) -> list[str]:
        columns = zip(self._columns.values(), zip(*cases, strict=True), strict=True)
        return [name, *(str(make(values)) for make, values in columns)]
