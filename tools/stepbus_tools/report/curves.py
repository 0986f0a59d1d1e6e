"""The curves of a picture: what was measured, and what it should have been."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.signals import Array, Signal, Tracking

Line = tuple[Array, Array]
"""Times [s] and values, both of shape (p,)."""

_MOST_POINTS = 8000


class Curve:
    """Several lines over time, in memory that does not grow with their length.

    Up to 8000 points all are there. Of more, each line has the least and the largest of each
    bucket; the buckets double whenever they are too many.
    together: the lines have their points at the same times, as the x and y of a path must.
    count: number of points that were added.
    """

    def __init__(self, *, together: bool = False) -> None:
        self.count = 0
        self._together = together
        # Both of shape (2, p, n): times and values of p points of n lines.
        self._kept: Array | None = None
        self._rest: Array | None = None
        self._bucket = 1

    def add(self, t: Array, values: Array) -> None:
        """Add points. t: shape (m,), [s]. values: shape (m, n)."""
        self.count += len(t)
        times = np.broadcast_to(t[:, None], values.shape)
        rest = self._rest = _joined(self._rest, np.stack((times, values)))
        least = 2 * values.shape[1] if self._together else 2
        if self._bucket == 1 and rest.shape[1] > _MOST_POINTS:
            self._bucket = 2 * least
        if self._bucket > 1:
            self._reduce(rest, least)

    def line(self, index: int) -> Line:
        """Return one line."""
        if self._rest is None:
            return np.empty(0), np.empty(0)
        t, values = _joined(self._kept, self._rest)[:, :, index]
        return t, values

    def _reduce(self, rest: Array, least: int) -> None:
        """Put points into buckets, of which `least` points are kept each."""
        most = _MOST_POINTS // (2 * least) * 2
        while rest.shape[1] >= self._bucket:
            held = 0 if self._kept is None else self._kept.shape[1] // least
            count = min(rest.shape[1] // self._bucket, most - held)
            full = rest[:, : count * self._bucket]
            rest = rest[:, count * self._bucket :]
            self._kept = _joined(self._kept, self._extremes(full, self._bucket))
            if held + count == most:
                self._kept = self._extremes(self._kept, 2 * least)
                self._bucket *= 2
        self._rest = rest.copy()

    def _extremes(self, points: Array, size: int) -> Array:
        """Return the least and the largest of each `size` points, in their order."""
        groups = points.reshape(2, -1, size, points.shape[2])
        filled = np.where(np.isnan(groups[1]), 0.0, groups[1])
        ends = [filled.argmin(axis=1), filled.argmax(axis=1)]
        if self._together:
            at = np.sort(np.concatenate(ends, axis=1), axis=1)[:, :, None]
        else:
            at = np.sort(np.stack(ends, axis=1), axis=1)
        at = np.broadcast_to(at, (2, *at.shape[:2], points.shape[2]))
        chosen: Array = np.take_along_axis(groups, at, axis=2)
        return chosen.reshape(2, -1, points.shape[2])


def _joined(first: Array | None, then: Array) -> Array:
    return then if first is None else np.concatenate((first, then), axis=1)


_TORQUE_ONLY = frozenset(("torque", "brake"))


class SignalCurves:
    """The lines of one port: all that `Signal` says of it, thinned for a plot."""

    def __init__(self, first: Signal) -> None:
        self.names: Sequence[str] = first.names
        self.limits: Mapping[str, Sequence[float]] = first.limits
        self.joint_types: Mapping[str, str] = first.joint_types
        self._modes: set[str] = set()
        self._curves: dict[str, Curve] = {}
        self._slope = _Slope()
        self._count = 0

    def take(self, signal: Signal) -> None:
        """Take the next piece."""
        self._count += len(signal.t)
        if list(signal.names) != list(self.names):
            return
        self._modes |= signal.modes
        for quantity, values in signal.fields.items():
            self._curves.setdefault(quantity, Curve()).add(signal.t, values)
        if "position" in signal.fields and "velocity" not in signal.fields:
            self._slope.take(signal.t, signal.fields["position"])

    @property
    def fields(self) -> set[str]:
        """Return the quantities that no piece lacks."""
        return {name for name, curve in self._curves.items() if curve.count == self._count}

    @property
    def is_torque(self) -> bool:
        """Return whether it commands torques, and nothing else but to brake."""
        return "torque" in self._modes and self._modes <= _TORQUE_ONLY

    def of(self, quantity: str, joint: str) -> Line | None:
        """Return one quantity of one joint; None where there is none."""
        if quantity not in self.fields or joint not in self.names:
            return None
        return self._curves[quantity].line(list(self.names).index(joint))

    def slope(self, joint: str) -> Line | None:
        """Return the velocity of a joint whose position alone is measured, by differences."""
        if "position" not in self.fields or joint not in self.names:
            return None
        return self._slope.line(list(self.names).index(joint))


class _Slope:
    """The finite difference of values over time; central, but at both ends."""

    def __init__(self) -> None:
        self._curve = Curve()
        self._last: tuple[Array, Array] | None = None

    def take(self, t: Array, values: Array) -> None:
        if self._last is not None:
            t = np.concatenate((self._last[0], t))
            values = np.concatenate((self._last[1], values))
        if len(t) > 2:
            # The first of these was added already; the last one has no successor yet.
            done = slice(1 if self._curve.count else 0, -1)
            self._curve.add(t[done], np.gradient(values, t, axis=0)[done])
            t, values = t[-2:].copy(), values[-2:].copy()
        self._last = (t, values)

    def line(self, index: int) -> Line:
        t, slope = self._curve.line(index)
        if self._last is None:
            return t, slope
        last_t, last = self._last[0], self._last[1][:, index]
        end = np.gradient(last, last_t) if len(last) > 1 else np.zeros_like(last)
        rest = slice(-1, None) if self._curve.count else slice(None)
        return np.concatenate((t, last_t[rest])), np.concatenate((slope, end[rest]))


class TrackingCurves:
    """The lines of states, references, commands and tracking errors, as `Tracking` has them.

    measured: joints, in the order of the states. joints: those of them with a reference.
    """

    def __init__(self) -> None:
        self.measured: list[str] = []
        self.joints: list[str] = []
        self._states: dict[str, SignalCurves] = {}
        self._references: dict[str, SignalCurves] = {}
        self._commands: dict[str, SignalCurves] = {}
        self._errors: dict[str, Curve] = {}

    def take(self, piece: Tracking) -> None:
        """Take the next piece of a recording."""
        for known, signals in (
            (self._states, piece.states),
            (self._references, piece.references),
            (self._commands, piece.commands),
        ):
            for topic, signal in signals.items():
                known.setdefault(topic, SignalCurves(signal)).take(signal)
        self.measured = _united(self.measured, piece.measured)
        self.joints = _united(self.joints, piece.joints)
        for joint in piece.joints or piece.measured:
            state = piece.state_of(joint)
            if state is not None:
                error = piece.error(joint) if piece.joints else _behind(state, joint)
                self._errors.setdefault(joint, Curve()).add(state.t, error[:, None])

    @property
    def has_targets(self) -> bool:
        """Return whether a plant reports the targets of its motors."""
        return any("target" in state.fields for state in self._states.values())

    @property
    def torques(self) -> list[SignalCurves]:
        """Return the ports that command torques."""
        return [curves for curves in self._commands.values() if curves.is_torque]

    def state_of(self, joint: str) -> SignalCurves | None:
        """Return the state that measures a joint."""
        return _with(joint, self._states)

    def reference_of(self, joint: str) -> SignalCurves | None:
        """Return the reference of a joint."""
        return _with(joint, self._references)

    def is_prismatic(self, joint: str) -> bool:
        """Return whether a joint slides."""
        state = self.state_of(joint)
        return state is not None and state.joint_types.get(joint) == "prismatic"

    def error(self, joint: str) -> Line:
        """Return reference minus measured position; without references, the targets of motors."""
        return self._errors[joint].line(0)


def _united(known: Sequence[str], more: Sequence[str]) -> list[str]:
    return list(dict.fromkeys((*known, *more)))


def _with(joint: str, curves: Mapping[str, SignalCurves]) -> SignalCurves | None:
    return next((one for one in curves.values() if joint in one.names), None)


def _behind(state: Signal, joint: str) -> Array:
    """Return target minus measured position of a joint, shape (m,) [rad or m]."""
    target, position = state.of("target", joint), state.of("position", joint)
    unknown = np.full(len(state.t), np.nan)
    return unknown if target is None or position is None else target - position


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
