"""The planner: finds collision-free paths of a robot's joints, timed within its limits."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from .participant import Planner

__all__ = ["Params", "Planner"]

__getattr__ = imported_later(__name__, {"Planner": "participant"})
