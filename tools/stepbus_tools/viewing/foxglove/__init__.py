"""Runs and recordings for Foxglove and Lichtblick: foxglove.* messages, and who sends them."""

from .feed import follow, play
from .foxglove_server import Server, open_server

__all__ = ["Server", "follow", "open_server", "play"]
