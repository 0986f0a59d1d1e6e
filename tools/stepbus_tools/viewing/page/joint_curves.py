"""The numbers of a page: thinned, written once each, as base64."""

import base64
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.signals import Array
from stepbus_tools.report.curves import Line, SignalCurves, TrackingCurves

_MOST_POINTS = 2000


class Arrays:
    """All arrays of a page; equal ones, such as the times of most lines, are there once."""

    def __init__(self) -> None:
        self._places: dict[bytes, int] = {}

    def line(
        self, label: str, t: Array, values: Array, style: Mapping[str, object] = {}
    ) -> Mapping[str, Any]:
        """Return a line of a chart; t: [s], values: both of shape (p,). style: for the script."""
        t, values = thin(t, values)
        at, y = self._place(b"d", t.astype("<f8")), self._place(b"f", values.astype("<f4"))
        return {"label": label, "t": at, "y": y, **style}

    @staticmethod
    def has(line: tuple[Array, Array] | None) -> bool:
        """Return whether a line has any number."""
        return line is not None and bool(np.isfinite(line[1]).any())

    def encoded(self) -> list[str]:
        """Return each array: `d` or `f`, then its little-endian numbers as base64."""
        return [data[:1].decode() + base64.b64encode(data[1:]).decode() for data in self._places]

    def _place(self, form: bytes, values: Array) -> int:
        return self._places.setdefault(form + values.tobytes(), len(self._places))


def thin(t: Array, values: Array, most: int = _MOST_POINTS) -> tuple[Array, Array]:
    """Return at most so many points, with the least and the largest of each bucket in order."""
    finite = np.where(np.isfinite(values), values, np.nan)
    if len(t) <= most:
        return t, finite
    edges = np.linspace(0, len(t), most // 2 + 1).astype(int)[:-1]
    owner = np.repeat(np.arange(len(edges)), np.diff([*edges, len(t)]))
    low, high = (
        np.lexsort((sign * np.where(np.isnan(finite), np.inf * sign, finite), owner))[edges]
        for sign in (1, -1)
    )
    rows = np.sort(np.stack((low, high), axis=1), axis=1).ravel()
    return t[rows], finite[rows]


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
    numbers = [float(row[index]) for row in rows if len(row) > index]
    if len(keys) == 1:
        numbers += [-value for value in numbers]
    return sorted(value for value in numbers if np.isfinite(value))


def _largest(line: Line) -> float:
    values = np.abs(line[1])
    return float(np.nanmax(values)) if len(values) and not np.isnan(values).all() else 0.0
