"""Draws a scene into pixels, without a display and without a graphics processor."""

from .images import pixels_of
from .raster import Painter, Pixels
from .viewpoint import NAMED, Viewpoint, parse_viewpoint, whole_scene

__all__ = ["NAMED", "Painter", "Pixels", "Viewpoint", "parse_viewpoint", "pixels_of", "whole_scene"]
