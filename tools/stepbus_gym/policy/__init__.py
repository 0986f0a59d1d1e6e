"""A policy as a participant of its own."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from stepbus_gym.policy.loaded import LoadedPolicy

__all__ = ["LoadedPolicy", "Params"]

__getattr__ = imported_later(__name__, {"LoadedPolicy": "loaded"})
