"""The world model: poses of the base and of the items, from what the robot senses."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from stepbus_store.world_model.world_model import WorldModel

__all__ = ["Params", "WorldModel"]

__getattr__ = imported_later(__name__, {"WorldModel": "world_model"})
