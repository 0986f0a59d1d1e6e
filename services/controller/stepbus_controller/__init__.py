"""The controller: from joint states and a reference to joint torques, by a law of your choice."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from .participant import Controller

__all__ = ["Controller", "Params"]

__getattr__ = imported_later(__name__, {"Controller": "participant"})
