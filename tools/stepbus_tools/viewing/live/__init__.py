"""A run that is going, while it is recorded: its page, and what a user can ask of it."""

from stepbus_tools.viewing.live.run_client import FRAME_S, Link, Turn, follow_run, latest_of

from .live_page import LivePage, follow

__all__ = ["FRAME_S", "Link", "LivePage", "Turn", "follow", "follow_run", "latest_of"]
