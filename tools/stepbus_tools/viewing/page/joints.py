"""Charts of joints: position, velocity, torque and error against reference and limits."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from stepbus_tools.report.curves.curve import Line
from stepbus_tools.report.curves.tracking import SignalCurves, TrackingCurves

from .arrays import Arrays

_MOST_OPEN = 4
"""More joints than that are folded, but the one with the largest error."""
_MOST_LINES = 14

Chart = Mapping[str, Any]
Group = Mapping[str, Any]


def joint_groups(curves: TrackingCurves, arrays: Arrays) -> Iterator[Group]:
    """Yield a group of charts for all joints, then one for each."""
    joints = curves.measured
    worst = max(joints, key=lambda joint: _largest(curves.error(joint)), default="")
    overview = _overview(curves, arrays)
    if len(joints) > 1 and overview["charts"]:
        yield overview
    for joint in joints:
        is_open = len(joints) <= _MOST_OPEN or joint == worst
        charts = [chart for chart in _charts(curves, joint, arrays) if chart["lines"]]
        yield {"title": joint, "open": is_open, "charts": charts}


def _overview(curves: TrackingCurves, arrays: Arrays) -> Group:
    shown = curves.measured[:_MOST_LINES]
    more = len(curves.measured) - len(shown)
    charts = []
    for is_sliding, unit in ((False, "rad"), (True, "m")):
        joints = [joint for joint in shown if curves.is_prismatic(joint) == is_sliding]
        errors = {joint: curves.error(joint) for joint in joints}
        lines = [arrays.line(n, *row) for n, row in errors.items() if arrays.has(row)]
        if lines:
            charts.append(_chart("all", "error", unit, lines))
    title = f"Error of all joints{f' ({more} more below)' if more else ''}"
    return {"title": title, "open": True, "charts": charts}


def _charts(curves: TrackingCurves, joint: str, arrays: Arrays) -> Iterator[Chart]:
    state, reference = curves.state_of(joint), curves.reference_of(joint)
    unit, force = ("m", "N") if curves.is_prismatic(joint) else ("rad", "N·m")

    def lines(*rows: tuple[str, Line | None, Mapping[str, object]]) -> list[Mapping[str, Any]]:
        return [arrays.line(n, *row, style) for n, row, style in rows if row and arrays.has(row)]

    def of(curves: SignalCurves | None, quantity: str) -> Line | None:
        return None if curves is None else curves.of(quantity, joint)

    dashed: Mapping[str, object] = {"dash": True, "color": 1}
    velocity = of(state, "velocity") or (None if state is None else state.slope(joint))
    yield _chart(joint, "error", unit, lines(("error", curves.error(joint), {"color": 3})))
    yield _chart(
        joint,
        "position",
        unit,
        lines(
            ("measured", of(state, "position"), {}),
            ("reference", of(reference, "position"), dashed),
            ("target", of(state, "target"), {"dash": True, "color": 2}),
        ),
        _limits(state, joint, "lower", "upper"),
    )
    yield _chart(
        joint,
        "velocity",
        f"{unit}/s",
        lines(("measured", velocity, {}), ("reference", of(reference, "velocity"), dashed)),
        _limits(state, joint, "velocity"),
    )
    commanded = [
        (f"command {i or ''}".strip(), of(c, "values"), dashed)
        for i, c in enumerate(curves.torques)
    ]
    yield _chart(
        joint,
        "torque" if force == "N·m" else "force",
        force,
        lines(("applied", of(state, "effort"), {}), *commanded),
        _limits(state, joint, "effort"),
    )


def _chart(
    joint: str,
    title: str,
    unit: str,
    lines: Sequence[Mapping[str, Any]],
    limits: Sequence[float] = (),
) -> Chart:
    key = f"joint/{joint}/{title}/{unit}"
    return {"key": key, "title": title, "unit": unit, "lines": lines, "limits": limits}


def _limits(state: SignalCurves | None, joint: str, *keys: str) -> list[float]:
    """Return the limits of a joint that are finite; of a single key, both signs of it."""
    if state is None or joint not in state.names:
        return []
    index = list(state.names).index(joint)
    rows = [state.limits.get(key, ()) for key in keys]
    found = [float(row[index]) for row in rows if len(row) > index]
    if len(keys) == 1:
        found += [-value for value in found]
    return sorted(value for value in found if np.isfinite(value))


def _largest(line: Line) -> float:
    values = np.abs(line[1])
    return float(np.nanmax(values)) if len(values) and not np.isnan(values).all() else 0.0
