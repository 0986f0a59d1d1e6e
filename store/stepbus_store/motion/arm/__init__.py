"""Goals of an arm."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from .participant import ArmController

__all__ = ["ArmController", "Params"]

__getattr__ = imported_later(__name__, {"ArmController": "participant"})
