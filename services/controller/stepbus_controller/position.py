"""A controller that commands positions, with its parameters."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .position_params import Params

if TYPE_CHECKING:
    from stepbus_controller.position_controller import PositionController

__all__ = ["Params", "PositionController"]

__getattr__ = imported_later("stepbus_controller", {"PositionController": "position_controller"})
