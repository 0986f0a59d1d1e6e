"""Small drawings of a page that need no script, and pictures as PNG."""

import base64
import io
from html import escape

import numpy as np
from numpy.typing import NDArray

from stepbus_participant import need


def run_sample(number: int) -> str:
    """Return how the lines of a run are drawn, by its place among several."""
    return line_sample(f"l6 run{number % 4}" if number else "l6")


def line_sample(style: str) -> str:
    """Return how lines of some classes are drawn."""
    return (
        '<svg viewBox="0 0 40 8" class="sample" aria-hidden="true">'
        f'<path class="{style}" d="M0 4H40"/></svg>'
    )


def png_figure(picture: bytes, caption: str, background: str = "") -> str:
    """Return a PNG with its caption. background: a colour, where the picture has none."""
    data, text = base64.b64encode(picture).decode(), escape(caption)
    style = f' style="background:{background}"' if background else ""
    return (
        f'<figure><img{style} alt="{text}" src="data:image/png;base64,{data}">'
        f"<figcaption>{text}</figcaption></figure>"
    )


def figure(pixels: NDArray[np.uint8], caption: str, background: str = "") -> str:
    """Return a picture with its caption; pixels: shape (rows, columns, 3), or 4 with what covers.

    Raises ExtraMissing without Pillow.
    """
    (pillow,) = need("a picture", "PIL.Image")
    stream = io.BytesIO()
    pillow.fromarray(np.ascontiguousarray(pixels)).save(stream, "PNG")
    return png_figure(stream.getvalue(), caption, background)
