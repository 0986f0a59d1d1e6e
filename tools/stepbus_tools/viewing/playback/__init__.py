"""The page over a recording: a time slider, events to jump to, a second recording beside it."""

from .history import History
from .playback import Playback, open_recording, play

__all__ = ["History", "Playback", "open_recording", "play"]
