"""Perception: which items a camera sees, and where they are."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from .participant import Perception

__all__ = ["Params", "Perception"]

__getattr__ = imported_later(__name__, {"Perception": "participant"})
