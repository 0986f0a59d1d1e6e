"""What the plots of joints share: colours, lines, legends."""

from typing import Any

from .curve import Line

_COLOURS = ("#1f77b4", "#d95f02", "#2ca02c", "#9467bd", "#8c564b", "#e377c2", "#7f7f7f", "#17becf")
_DASHED = {"color": "black", "linestyle": (0, (4, 6)), "linewidth": 1.1, "zorder": 3}


def line(axis: Any, points: Line, label: str, index: int, *, dashed: bool = False) -> None:
    """Plot one line. index: of its joint, which decides the colour."""
    style = _DASHED if dashed else {"color": _COLOURS[index % len(_COLOURS)], "linewidth": 2}
    axis.plot(*points, label=label, **style)


def legend(axis: Any) -> None:
    """Add a legend where there is a line with a name."""
    if axis.get_legend_handles_labels()[0]:
        axis.legend(loc="best", fontsize=9)


def write_instead(axis: Any, text: str) -> None:
    """Write a sentence where there is nothing to plot."""
    axis.text(0.5, 0.5, text, transform=axis.transAxes, ha="center", color="grey")
