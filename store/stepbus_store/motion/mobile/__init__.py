"""Goals of an arm on a mobile base with a gripper."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from .participant import MobileController

__all__ = ["MobileController", "Params"]

__getattr__ = imported_later(__name__, {"MobileController": "participant"})
