"""How late the steps of a run in real time began."""

from collections.abc import Mapping

import msgspec

_UNITS = (("s", 1e6), ("ms", 1e3), ("µs", 1.0))
_KEPT = 0.95
"""A share of the asked speed below it is worth a word."""


class Lateness(msgspec.Struct, frozen=True, kw_only=True):
    """How late the steps of a run began, by the wall clock.

    factor: simulated over wall time that was asked for. steps: that began. p50_us, p99_us, max_us:
    of their lateness [µs]. histogram: lateness up to [µs] → steps; `more`: the rest. late:
    participant → how many steps it held past the next grid point. kept: share of the speed that was
    asked for, up to the last step; behind_s: how late that was [s].
    """

    factor: float
    steps: int
    p50_us: float
    p99_us: float
    max_us: float
    histogram: Mapping[str, int]
    late: Mapping[str, int]
    kept: float = 1.0
    behind_s: float = 0.0

    def complaint(self) -> str:
        """Return what to say of a run that did not keep the time it was asked for; or nothing."""
        if self.kept >= _KEPT:
            return ""
        held = ", ".join(f"{count} by {name}" for name, count in self.late.items()) or "none"
        reached = self.factor * self.kept
        return (
            f"real time was not kept: {reached:.2f} instead of {self.factor:g}; the last step was "
            f"{self.behind_s:.1f} s late (steps held past their time: {held})"
        )


def in_units(us: float) -> str:
    """Return a duration as people read it: µs, ms or s, with three digits. us: [µs]."""
    unit, size = next((row for row in _UNITS if us >= row[1]), _UNITS[-1])
    return f"{float(f'{us / size:.3g}'):g} {unit}"
