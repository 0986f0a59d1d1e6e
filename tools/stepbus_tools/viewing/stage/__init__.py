"""Draws scenes with viser: the page of a view, and the file of an export."""

from .server import Page, open_page
from .stage import Stage

__all__ = ["Page", "Stage", "open_page"]
