"""The round trip: sends arms to random reachable poses and measures their errors."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from .round_trip import RoundTrip

__all__ = ["Params", "RoundTrip"]

__getattr__ = imported_later(__name__, {"RoundTrip": "round_trip"})
