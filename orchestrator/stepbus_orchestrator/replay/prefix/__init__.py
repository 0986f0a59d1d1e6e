"""The prefix of a run: steps of a recording, which each participant repeats by itself."""

from .prefix import RecordedPrefix

__all__ = ["RecordedPrefix"]
