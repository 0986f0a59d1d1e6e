"""The mission: references with exact derivatives, from a generator of your choice."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .references.params import Params

if TYPE_CHECKING:
    from .references.participant import Mission

__all__ = ["Mission", "Params"]

__getattr__ = imported_later(__name__, {"Mission": "references.participant"})
