"""The theme of everything that stepbus draws: its mark, typefaces and colours.

Reports, pages, pictures and the site take them from here. Seven colours and two line styles tell
fourteen lines apart; the colours differ for readers with any colour blindness too, which
`tests/tools/test_theme.py` measures, and have a contrast of 3:1 with what they are drawn on.
"""

import base64
import io
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepbus_participant import ExtraMissing, lacks, need

TEXT_FONT = '"Inter", "Segoe UI", system-ui, -apple-system, "Helvetica Neue", sans-serif'
NUMBER_FONT = '"JetBrains Mono", ui-monospace, "SF Mono", Consolas, "DejaVu Sans Mono", monospace'

LINES = ("#0668bb", "#e8480c", "#16966a", "#ad3288", "#3d96d8", "#6a8f08", "#2f3b48")
"""Colours of lines on white: blue, red, green, purple, sky, olive, ink."""
LINES_DARK = ("#5d86ff", "#f2672c", "#35b882", "#bb6fc8", "#8ae0ff", "#e6d21a", "#ffffff")
"""The same on a dark page."""

PAPER: Mapping[str, str] = {
    "ink": "#1b2430",
    "soft": "#56626f",
    "line": "#dbe1e8",
    "paper": "#ffffff",
    "raised": "#f5f7fa",
    "accent": "#0668bb",
    "good": "#1a7f4b",
    "bad": "#c0262d",
    "warn": "#9a6700",
}
"""Colours of a page by day."""
NIGHT: Mapping[str, str] = {
    "ink": "#e6ebf1",
    "soft": "#a3b0be",
    "line": "#333d49",
    "paper": "#14191f",
    "raised": "#1c232b",
    "accent": "#7aa2ff",
    "good": "#4cc38a",
    "bad": "#ff7a80",
    "warn": "#e5b454",
}
"""Colours of a page by night."""

MARK = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="48" height="48" viewBox="0 0 32 32">'
    '<rect width="32" height="32" rx="7" fill="#0668bb"/>'
    '<path d="M6 23h6v-5h7v-5h7" fill="none" stroke="#fff" stroke-width="3" '
    'stroke-linecap="round" stroke-linejoin="round"/>'
    '<circle cx="6" cy="23" r="2.5" fill="#fff"/><circle cx="26" cy="13" r="2.5" fill="#fff"/>'
    '<path d="M6 8h20" stroke="#9fd0ff" stroke-width="3" stroke-linecap="round"/></svg>'
)
"""The mark: steps below a bus. An SVG."""


@dataclass(frozen=True)
class LineStyle:
    """How a line is drawn: the number of its colour, and whether it is broken."""

    color: int
    is_broken: bool


def line_style(number: int) -> LineStyle:
    """Return the style of the line with a number; a joint's is its place among all joints."""
    rest, color = divmod(number, len(LINES))
    return LineStyle(color, bool(rest % 2))


def style_sheet() -> str:
    """Return the colours and typefaces as CSS: custom properties, by day and by night.

    Of class `l0` is a line of the first colour, of class `f0` what is filled with it.
    """
    day, night = (
        "".join(f"--{name}:{value};" for name, value in page.items())
        + "".join(f"--c{number}:{value};" for number, value in enumerate(lines))
        for page, lines in ((PAPER, LINES), (NIGHT, LINES_DARK))
    )
    fonts = f"--text:{TEXT_FONT};--numbers:{NUMBER_FONT};"
    classes = "".join(
        f".l{n}{{color:var(--c{n})}}.f{n}{{background:var(--c{n})}}" for n in range(len(LINES))
    )
    return (
        f":root{{color-scheme:light dark;{fonts}{day}}}"
        f"@media screen and (prefers-color-scheme:dark){{:root{{{night}}}}}{classes}"
    )


def uplot(what: str) -> tuple[str, str]:
    """Return the script and the style sheet of uPlot, which the package uplot-python carries.

    what: needs it. Raises ExtraMissing without the package.
    """
    # It is not imported: that would load IPython.
    spec = find_spec("uplot")
    for place in (spec.submodule_search_locations or ()) if spec else ():
        if (static := Path(place) / "static").is_dir():
            script, style = static / "uPlot.iife.js", static / "uPlot.min.css"
            return script.read_text("utf-8"), style.read_text("utf-8")
    raise ExtraMissing(lacks(what, "uplot"))


_PREFIXES = ((1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
_FROM = 0.1
"""Of a prefix: 0.1 mrad rather than 100 µrad."""
_TAKES = re.compile(r"(rad|m|N|J|V|A|W)(?![a-zA-Z])")
"""Units that take a prefix; seconds of a simulation are compared, so they have none."""
_KILO = "NJVAW"


def prefixed(largest: float, unit: str) -> tuple[float, str]:
    """Return the factor and the prefixed unit for numbers up to a size."""
    size = abs(largest)
    if _TAKES.match(unit) and size > 0 and math.isfinite(size):
        for factor, prefix in _PREFIXES:
            least = factor if factor >= 1e3 else _FROM * factor
            if size >= least * (1 - 1e-9) and (factor < 1e3 or unit[0] in _KILO):
                return 1 / factor, prefix + unit
        return 1e9, f"n{unit}"
    return 1.0, unit


def engineering(value: float, unit: str) -> str:
    """Return a number of three digits with its unit."""
    factor, shown = prefixed(value, unit)
    return f"{value * factor:.3g} {shown}".strip()


def png_figure(picture: bytes, caption: str, background: str = "") -> str:
    """Return a PNG with its caption. background: a colour, where the picture has none."""
    data, text = base64.b64encode(picture).decode(), escape(caption)
    style = f' style="background:{background}"' if background else ""
    return (
        f'<figure><img{style} alt="{text}" src="data:image/png;base64,{data}">'
        f"<figcaption>{text}</figcaption></figure>"
    )


def figure(pixels: NDArray[np.uint8], caption: str, background: str = "") -> str:
    """Return a picture with its caption, as HTML; pixels: shape (rows, columns, 3 or 4 with alpha).

    Raises ExtraMissing without Pillow.
    """
    (pillow,) = need("a picture", "PIL.Image")
    stream = io.BytesIO()
    pillow.fromarray(np.ascontiguousarray(pixels)).save(stream, "PNG")
    return png_figure(stream.getvalue(), caption, background)
