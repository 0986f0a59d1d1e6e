"""Replay: one participant, fed with what a recording says its peers sent, and compared with it."""

from .execute import WINDOW, replay
from .result import ReplayResult

__all__ = ["WINDOW", "ReplayResult", "replay"]
