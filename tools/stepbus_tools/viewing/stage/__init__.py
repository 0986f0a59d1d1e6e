"""Draws scenes with viser: the page of a view, and the file of an export."""

from .camera import look_at
from .curves import Data, Signal
from .server import Page, open_page
from .stage import OTHER_COLOR, Stage
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
