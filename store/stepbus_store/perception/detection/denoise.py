"""Takes the noise out of an image, and leaves the edges."""

from dataclasses import replace

import cv2
import numpy as np

from stepbus_store.perception.images import View

_WINDOW = 7
"""Diameter of the filters' windows [pixel]."""
_WIDTH = 2.0
"""Standard deviation of their weights [pixel]."""
_SAME = 3.0
"""Depths this many deviations apart belong to different surfaces."""
_COLOR = 40.0
"""The same for colours, of 255."""
_FAR = 100.0


def denoised(view: View, noise: float) -> View:
    """Return a view after bilateral filters (Tomasi and Manduchi, 1998).

    noise: standard deviation of depth at 1 m [m]; it grows with the square of the distance. So
    the filter works on the inverse of depth, in which the noise is the same everywhere.
    """
    known = np.isfinite(view.depth) & (view.depth > 0)
    inverse = np.where(known, 1.0 / np.where(known, view.depth, 1.0), 1.0 / _FAR)
    once = cv2.bilateralFilter(inverse.astype(np.float32), _WINDOW, _SAME * noise, _WIDTH)
    twice = cv2.bilateralFilter(once, _WINDOW, _SAME * noise, _WIDTH)
    depth = np.where(known, 1.0 / twice.astype(np.float64), view.depth)
    rgb = cv2.bilateralFilter(view.rgb, 5, _COLOR, 1.5)
    return replace(view, depth=depth, rgb=np.asarray(rgb, dtype=np.uint8))
