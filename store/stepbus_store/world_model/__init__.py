"""The world model: where a robot is and what stands around it, by its own sensors and a map."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from .participant import WorldModel

__all__ = ["Params", "WorldModel"]

__getattr__ = imported_later(__name__, {"WorldModel": "participant"})
