"""Replay: one participant, fed with what a recording says its peers sent, and compared with it."""

from stepbus_orchestrator.replay.execute import WINDOW, replay
from stepbus_orchestrator.replay.replay_result import ReplayResult

__all__ = ["WINDOW", "ReplayResult", "replay"]
