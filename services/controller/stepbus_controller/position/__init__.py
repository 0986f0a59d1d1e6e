"""Targets for joints with motors of their own."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from .participant import PositionController

__all__ = ["Params", "PositionController"]

__getattr__ = imported_later(__name__, {"PositionController": "participant"})
