"""An arm that goes from pose to pose and reports how well it holds each."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from .participant import RoundTrip

__all__ = ["Params", "RoundTrip"]

__getattr__ = imported_later(__name__, {"RoundTrip": "participant"})
