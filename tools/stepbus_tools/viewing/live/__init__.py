"""A run that is going, while it is recorded: its page, and what a user can ask of it."""

from .following import FRAME_S, Turn, follow_run, latest_of
from .link import Link
from .live_page import LivePage, follow

__all__ = ["FRAME_S", "Link", "LivePage", "Turn", "follow", "follow_run", "latest_of"]
