"""What the plots of joints share: colours, lines, legends."""

from typing import Any

from stepbus_tools.report.curves import Line

_COLOURS = ("#1f77b4", "#d95f02", "#2ca02c", "#9467bd", "#8c564b", "#e377c2", "#7f7f7f", "#17becf")
_MOST_ROWS = 12
_DASHED = {"color": "black", "linestyle": (0, (4, 6)), "linewidth": 1.1, "zorder": 3}


def line(axis: Any, points: Line, label: str, index: int, *, dashed: bool = False) -> None:
    """Plot one line. index: of its joint, which decides the colour."""
    style = _DASHED if dashed else {"color": _COLOURS[index % len(_COLOURS)], "linewidth": 2}
    axis.plot(*points, label=label, **style)


def legend(axis: Any) -> None:
    """Add a legend beside the axis, so that it covers no curve, where there is a named line."""
    labels = axis.get_legend_handles_labels()[1]
    if labels:
        place = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "borderaxespad": 0.0}
        axis.legend(**place, frameon=False, fontsize=9, ncols=1 + (len(labels) - 1) // _MOST_ROWS)
