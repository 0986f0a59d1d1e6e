"""Small drawings of a page that need no script, and pictures as PNG."""

import base64
import struct
import zlib
from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from stepbus_tools.look import LINES


def legend(names: Sequence[str]) -> str:
    """Return names beside their colours."""
    return (
        '<p class="legend">'
        + "".join(
            f'<span><i class="f{i % len(LINES)}"></i>{escape(name)}</span>'
            for i, name in enumerate(names)
        )
        + "</p>"
    )


def run_sample(number: int) -> str:
    """Return how the lines of a run are drawn, by its place among several."""
    return line_sample(f"l6 run{number % 4}" if number else "l6")


def line_sample(style: str) -> str:
    """Return how lines of some classes are drawn."""
    return (
        '<svg viewBox="0 0 40 8" class="small sample" aria-hidden="true">'
        f'<path class="{style}" d="M0 4H40"/></svg>'
    )


def png(pixels: NDArray[np.uint8]) -> bytes:
    """Return a picture as PNG; pixels: shape (rows, columns, 3), or 4 with what covers."""
    rows, columns, channels = pixels.shape
    lines = np.zeros((rows, 1 + channels * columns), np.uint8)
    lines[:, 1:] = pixels.reshape(rows, -1)
    # The difference to the row above compresses to half.
    lines[1:, 1:] -= pixels.reshape(rows, -1)[:-1]
    lines[1:, 0] = 2
    head = struct.pack(">IIBBBBB", columns, rows, 8, 2 if channels == 3 else 6, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(lines.tobytes(), 6)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in chunks
    )


def figure(pixels: NDArray[np.uint8], caption: str, background: str = "") -> str:
    """Return a picture with its caption. background: a colour, where the picture has none."""
    data = base64.b64encode(png(pixels)).decode()
    text = escape(caption)
    style = f' style="background:{background}"' if background else ""
    return (
        f'<figure><img{style} alt="{text}" src="data:image/png;base64,{data}">'
        f"<figcaption>{text}</figcaption></figure>"
    )
