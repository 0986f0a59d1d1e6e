"""How late the steps of a run in real time began."""

from collections.abc import Mapping

import msgspec


class Lateness(msgspec.Struct, frozen=True, kw_only=True):
    """How late the steps of a run began, by the wall clock.

    factor: simulated over wall time that was asked for. steps: that began. p50_us, p99_us, max_us:
    of their lateness [µs]. histogram: lateness up to [µs] → steps; `more`: the rest. late:
    participant → how many steps it held past the next grid point.
    """

    factor: float
    steps: int
    p50_us: float
    p99_us: float
    max_us: float
    histogram: Mapping[str, int]
    late: Mapping[str, int]
