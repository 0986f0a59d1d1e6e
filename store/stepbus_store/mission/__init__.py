"""Sales in a store: a state machine that fetches items from shelves, one after the other."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from stepbus_store.mission.store_mission import StoreMission

__all__ = ["Params", "StoreMission"]

__getattr__ = imported_later(__name__, {"StoreMission": "store_mission"})
