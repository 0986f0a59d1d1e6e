"""A mission that sends goals one after the other."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from .participant import GoalSequence

__all__ = ["GoalSequence", "Params"]

__getattr__ = imported_later(__name__, {"GoalSequence": "participant"})
