"""How late the steps of a run in real time were, as a panel."""

from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.run.reports.lateness import Lateness, in_units
from stepbus_orchestrator.run.reports.result import RESULT_FILE
from stepbus_participant import read_file
from stepbus_schemas import UNDECODABLE

from .panels.devices import Panel
from .panels.style import colour


class _Result(msgspec.Struct):
    real_time: Lateness | None = None


def read_lateness(folder: Path) -> Lateness | None:
    """Return how late the steps of a run were; None where it was not in real time.

    folder: of the run; its result.json has it.
    """
    try:
        return msgspec.json.decode(read_file(folder / RESULT_FILE), type=_Result).real_time
    except (OSError, *UNDECODABLE):
        return None


def lateness_panels(lateness: Lateness | None) -> list[Panel]:
    """Return a panel with a histogram; none for a run that was not in real time."""
    return [] if lateness is None else [partial(_draw, lateness=lateness)]


def _draw(axis: Any, lateness: Lateness) -> None:
    counts = list(lateness.histogram.values())
    labels = [f"≤ {bound}" if bound.isdecimal() else bound for bound in lateness.histogram]
    bars = axis.bar(labels, counts, color=colour(0))
    axis.bar_label(bars, [f"{count}" if count else "" for count in counts], fontsize=8)
    axis.set_yscale("symlog")
    axis.margins(y=0.15)
    axis.tick_params(axis="x", labelsize=8)
    axis.set_xlabel("lateness [µs]")
    axis.set_ylabel("steps")
    held = ", ".join(f"{name} {count}" for name, count in lateness.late.items())
    axis.set_title(
        f"lateness at {lateness.factor:g} × real time: p50 {in_units(lateness.p50_us)}, "
        f"p99 {in_units(lateness.p99_us)}, max {in_units(lateness.max_us)}"
        + (f"\nsteps held past their time: {held}" if held else ""),
        loc="left",
        fontsize=10,
    )
