"""Small drawings of a page that need no script, and pictures as PNG."""

import base64
import struct
import zlib
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.analysis.signals import Array

_COLOURS = 8
_MOST_POINTS = 2000


def legend(names: Sequence[str]) -> str:
    """Return names beside their colours."""
    return (
        '<p class="legend">'
        + "".join(
            f'<span><i class="c{i % _COLOURS}"></i>{escape(name)}</span>'
            for i, name in enumerate(names)
        )
        + "</p>"
    )


def path_from_above(paths: Mapping[str, Array]) -> str:
    """Return the paths of bases, x to the right and y up. paths: name → shape (p, 2), [m]."""
    every = np.concatenate([np.empty((0, 2)), *paths.values()])
    every = every[np.isfinite(every).all(axis=1)]
    if not len(every):
        return ""
    low, high = every.min(axis=0), every.max(axis=0)
    span = float(max(high - low)) or 1.0
    edge = 0.08 * span + 0.05
    x, y = low[0] - edge, -high[1] - edge
    width, height = high[0] - low[0] + 2 * edge, high[1] - low[1] + 2 * edge
    parts = []
    for number, points in enumerate(paths.values()):
        step = max(1, len(points) // _MOST_POINTS)
        kept = np.concatenate((points[::step], points[-1:]))
        dots = " ".join(f"{a:.4g},{-b:.4g}" for a, b in kept if np.isfinite(a + b))
        start, end = points[0], points[-1]
        parts.append(
            f'<polyline class="c{number % _COLOURS}" points="{dots}"/>'
            f'<circle class="c{number % _COLOURS}" cx="{end[0]:.4g}" cy="{-end[1]:.4g}" '
            f'r="{span / 60:.4g}"><title>end</title></circle>'
            # Wider, so that it is seen around the end of a base that has come back.
            f'<circle class="start" cx="{start[0]:.4g}" cy="{-start[1]:.4g}" r="{span / 40:.4g}">'
            "<title>start</title></circle>"
        )
    box = f"{x:.4g} {y:.4g} {width:.4g} {height:.4g}"
    size = f"{high[0] - low[0]:.2f} m × {high[1] - low[1]:.2f} m"
    return (
        f'<svg class="path" role="img" viewBox="{box}">{"".join(parts)}</svg>{legend(list(paths))}'
        f"<p>{size}; open circle: start, x ahead to the right, y to the top</p>"
    )


def png(pixels: NDArray[np.uint8]) -> bytes:
    """Return a picture as PNG; pixels: shape (rows, columns, 3)."""
    rows, columns, _ = pixels.shape
    lines = np.zeros((rows, 1 + 3 * columns), np.uint8)
    lines[:, 1:] = pixels.reshape(rows, -1)
    # The difference to the row above compresses to half.
    lines[1:, 1:] -= pixels.reshape(rows, -1)[:-1]
    lines[1:, 0] = 2
    head = struct.pack(">IIBBBBB", columns, rows, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(lines.tobytes(), 6)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in chunks
    )


def figure(pixels: NDArray[np.uint8], caption: str) -> str:
    """Return a picture with its caption."""
    data = base64.b64encode(png(pixels)).decode()
    text = escape(caption)
    return (
        f'<figure><img alt="{text}" src="data:image/png;base64,{data}">'
        f"<figcaption>{text}</figcaption></figure>"
    )
