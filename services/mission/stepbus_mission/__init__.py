"""The mission: references with exact derivatives, from a generator of your choice."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from .mission import Mission

__all__ = ["Mission", "Params"]

__getattr__ = imported_later(__name__, {"Mission": "mission"})
