"""Controllers: torques or positions of joints, from measurements and references."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from stepbus_controller.controller import Controller

__all__ = ["Controller", "Params"]

__getattr__ = imported_later(__name__, {"Controller": "controller"})
