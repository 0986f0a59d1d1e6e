"""A controller that carries out goals of an arm."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from stepbus_store.motion.arm.arm_controller import ArmController

__all__ = ["ArmController", "Params"]

__getattr__ = imported_later(__name__, {"ArmController": "arm_controller"})
