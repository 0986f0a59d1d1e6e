"""A controller that carries out goals of a mobile manipulator."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from stepbus_store.motion.mobile.mobile_controller import MobileController

__all__ = ["MobileController", "Params"]

__getattr__ = imported_later(__name__, {"MobileController": "mobile_controller"})
