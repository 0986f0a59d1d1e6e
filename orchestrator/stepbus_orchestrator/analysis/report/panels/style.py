"""What the plots of joints share: colours, lines, legends."""

from collections.abc import Sequence
from typing import Any

from stepbus_orchestrator.analysis.report.curves.curve import Line

_COLOURS = ("#1f77b4", "#d95f02", "#2ca02c", "#9467bd", "#8c564b", "#e377c2", "#7f7f7f", "#17becf")
_DASHED = {"color": "black", "linestyle": (0, (4, 6)), "linewidth": 1.1, "zorder": 3}


def colour(index: int) -> str:
    """Return the colour of a joint."""
    return _COLOURS[index % len(_COLOURS)]


def line(axis: Any, points: Line, label: str, index: int, *, dashed: bool = False) -> None:
    """Plot one line. index: of its joint, which decides the colour."""
    style = _DASHED if dashed else {"color": colour(index), "linewidth": 2}
    axis.plot(*points, label=label, **style)


def legend(axis: Any, handles: Sequence[Any] | None = None, *, right: float = 1.01) -> None:
    """Add a legend beside the axis where there is a line with a name.

    handles: its lines; None: all of the axis. right: its left end, as a share of the width.
    """
    shown = axis.get_legend_handles_labels()[0] if handles is None else handles
    if shown:
        axis.legend(
            handles=shown,
            loc="upper left",
            bbox_to_anchor=(right, 1.0),
            borderaxespad=0.0,
            frameon=False,
            fontsize=9,
        )


def write_instead(axis: Any, text: str) -> None:
    """Write a sentence where there is nothing to plot."""
    axis.text(0.5, 0.5, text, transform=axis.transAxes, ha="center", color="grey")
