"""The planner: collision-free, timed motions of an arm and a base."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from stepbus_store.planner.planner import Planner

__all__ = ["Params", "Planner"]

__getattr__ = imported_later(__name__, {"Planner": "planner"})
