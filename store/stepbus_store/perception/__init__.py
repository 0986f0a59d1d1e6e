"""Perception: detects items and landmarks in images."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from stepbus_store.perception.perception import Perception

__all__ = ["Params", "Perception"]

__getattr__ = imported_later(__name__, {"Perception": "perception"})
