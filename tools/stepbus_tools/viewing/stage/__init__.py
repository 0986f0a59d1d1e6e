"""Draws scenes with viser: the page of a view, and the file of an export."""

from .curves import Data, Signal
from .server import Page, open_page
from .stage import OTHER_COLOR, Stage, look_at
from .view import View, plain_topics

__all__ = [
    "OTHER_COLOR",
    "Data",
    "Page",
    "Signal",
    "Stage",
    "View",
    "look_at",
    "open_page",
    "plain_topics",
]
