"""The lines of the plots of joints, taken from a recording piece by piece."""

from collections.abc import Mapping, Sequence

import numpy as np

from stepbus_orchestrator.analysis.signals import Array, Signal, Tracking

from .curve import Curve, Line

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

    def largest(self, quantity: str) -> float:
        """Return the largest absolute value of a quantity; 0 without any."""
        rows = [line[1] for joint in self.names if (line := self.of(quantity, joint))]
        values = np.abs(np.concatenate(rows)) if rows else np.empty(0)
        return float(np.nanmax(values, initial=0.0))


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
    """The lines of state, reference, command and tracking error.

    state, reference: of the first port of each type; None without one. joints: those both have.
    """

    def __init__(self) -> None:
        self.state: SignalCurves | None = None
        self.reference: SignalCurves | None = None
        self.joints: list[str] = []
        self._commands: dict[str, SignalCurves] = {}
        self._errors: dict[str, Curve] = {}

    def take(self, piece: Tracking) -> None:
        """Take the next piece of a recording."""
        self.state = _extended(self.state, piece.state)
        self.reference = _extended(self.reference, piece.reference)
        for topic, signal in piece.commands.items():
            known = _extended(self._commands.get(topic), signal)
            if known is not None:
                self._commands[topic] = known
        self.joints = piece.joints or self.joints
        if piece.state is not None:
            for joint in piece.joints or piece.state.names:
                error = piece.error(joint) if piece.joints else _behind(piece.state, joint)
                self._errors.setdefault(joint, Curve()).add(piece.state.t, error[:, None])

    @property
    def command(self) -> SignalCurves | None:
        """Return the first port that commands torques."""
        return next((curves for curves in self._commands.values() if curves.is_torque), None)

    def error(self, joint: str) -> Line:
        """Return reference minus measured position; without references, the targets of motors."""
        return self._errors[joint].line(0)


def _extended(curves: SignalCurves | None, signal: Signal | None) -> SignalCurves | None:
    if signal is None:
        return curves
    curves = curves or SignalCurves(signal)
    curves.take(signal)
    return curves


def _behind(state: Signal, joint: str) -> Array:
    """Return target minus measured position of a joint, shape (m,) [rad]."""
    target, position = state.of("target", joint), state.of("position", joint)
    unknown = np.full(len(state.t), np.nan)
    return unknown if target is None or position is None else target - position
