"""How well joints follow a sinusoid: amplitude and lag, and whether the others stand still."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .signals import Array, Tracking

# The acceleration of a sinusoid is −ω² times its distance from the centre; to this precision.
_IS_SINUSOID = 1e-6
_FEWEST = 4


@dataclass(frozen=True, kw_only=True)
class SinusoidFit:
    """One joint that follows a sinusoid.

    wanted, measured: amplitudes in `unit`, which is rad or m. lag_s: how far the measured one is
    behind [s]; NaN for a joint that never moved.
    """

    joint: str
    wanted: float
    measured: float
    lag_s: float
    unit: str = "rad"

    @property
    def excess(self) -> float:
        """Return by how much the measured amplitude is too large, relative to the wanted one."""
        return self.measured / self.wanted - 1.0


class _Span:
    """The range of values."""

    def __init__(self) -> None:
        self.least, self.largest, self.count = np.inf, -np.inf, 0

    def take(self, values: Array) -> None:
        if len(values):
            self.least = np.minimum(self.least, values.min())
            self.largest = np.maximum(self.largest, values.max())
            self.count += len(values)

    @property
    def width(self) -> float:
        return float(self.largest - self.least) if self.count else 0.0


class _LeastSquares:
    """Least squares over pieces of rows: each is reduced to the triangle of its QR decomposition.

    One piece alone is solved as it is.
    """

    def __init__(self) -> None:
        self._rows: Array | None = None

    def take(self, columns: Array, values: Array) -> None:
        """Add rows. columns: shape (m, k). values: shape (m,)."""
        rows = np.column_stack((columns, values))
        if self._rows is not None:
            triangle: Any = np.linalg.qr(np.vstack((self._rows, rows)), mode="r")
            rows = triangle
        self._rows = rows

    def solution(self) -> Array:
        """Return the coefficients, shape (k,)."""
        rows = np.empty((0, 1)) if self._rows is None else self._rows
        found: Any = np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=None)[0]
        return np.asarray(found)

    def rms(self, count: int) -> float:
        """Return the root mean square of what remains. count: number of rows that were taken."""
        rows = np.empty((0, 1)) if self._rows is None else self._rows
        rest = rows[:, :-1] @ self.solution() - rows[:, -1]
        return float(np.linalg.norm(rest) / np.sqrt(count))


@dataclass(kw_only=True)
class _Motion:
    """What one pass finds out about a joint.

    line: of its reference's acceleration over its position. first: measured position at the start.
    strayed: largest distance from it.
    """

    position: _Span = field(default_factory=_Span)
    acceleration: _Span = field(default_factory=_Span)
    line: _LeastSquares = field(default_factory=_LeastSquares)
    first: float | None = None
    unit: str = "rad"
    strayed: float = 0.0

    def take(self, piece: Tracking, joint: str) -> None:
        """Take the next piece of a recording."""
        reference, state = piece.reference_of(joint), piece.state_of(joint)
        if reference is None or state is None:
            return
        self.unit = piece.unit(joint)
        q, a = reference.of("position", joint), reference.of("acceleration", joint)
        if q is not None:
            self.position.take(q)
        if q is not None and a is not None:
            self.acceleration.take(a)
            self.line.take(np.column_stack((q, np.ones_like(q))), a)
        measured = state.of("position", joint)
        if measured is not None and len(measured):
            self.first = float(measured[0]) if self.first is None else self.first
            self.strayed = float(np.maximum(self.strayed, np.abs(measured - self.first).max()))

    def candidate(self) -> tuple[float, float] | None:
        """Return slope and offset of the line, unless no sinusoid has such a reference."""
        q, a = self.position, self.acceleration
        varies = all(0.0 < span.width < np.inf for span in (q, a))
        if a.count < _FEWEST or a.count != q.count or not varies:
            return None
        slope, offset = self.line.solution()
        is_one = slope < 0 and self.line.rms(a.count) < _IS_SINUSOID * a.width
        return (float(slope), float(offset)) if is_one else None


class JointMotions:
    """Which joints follow a sinusoid, and which should stand still.

    Give it all pieces of a recording; a fit reads them once more. Of a recording in several
    pieces the fit may differ from that in one in the last digits of a double.
    """

    def __init__(self) -> None:
        self._motions: dict[str, _Motion] = {}
        self._last_s = 0.0

    def take(self, piece: Tracking) -> None:
        """Take the next piece of a recording."""
        ends = [float(state.t[-1]) for state in piece.states.values() if len(state.t)]
        self._last_s = max([self._last_s, *ends])
        for joint in piece.joints:
            self._motions.setdefault(joint, _Motion()).take(piece, joint)

    def at_rest(self, unit: str = "rad") -> tuple[str, float] | None:
        """Return which of the joints that should stand still moves most, and how far.

        unit: of the joints that are compared, rad or m.
        """
        rows = [
            (joint, motion.strayed)
            for joint, motion in self._motions.items()
            if motion.position.count
            and motion.position.width == 0.0
            and motion.first is not None
            and motion.unit == unit
        ]
        return max(rows, key=lambda row: row[1], default=None)

    def fits(self, pieces: Iterable[Tracking], after_s: float) -> list[SinusoidFit]:
        """Return a fit for every joint whose reference is a sinusoid, over whole periods.

        pieces: of the same recording. after_s: what comes before is left out [s].
        """
        waves = []
        for joint, motion in self._motions.items():
            line = motion.candidate()
            if line is not None:
                most = _IS_SINUSOID * motion.acceleration.width
                wave = _Wave(joint, line, most, motion.unit)
                if wave.over_periods(after_s, self._last_s):
                    waves.append(wave)
        if waves:
            for piece in pieces:
                for wave in waves:
                    wave.take(piece)
        return [fit for wave in waves if (fit := wave.fit()) is not None]

    def lines(self, pieces: Iterable[Tracking], after_s: float) -> list[str]:
        """Return what a summary says of the joints that follow a sinusoid, in degrees or m."""
        fits = self.fits(pieces, after_s)
        lines = [f"sinusoid  {fit.joint}: {_amplitude(fit)}" for fit in fits]
        for unit in ("rad", "m"):
            still = self.at_rest(unit)
            if fits and still is not None:
                joint, strayed = still
                lines.append(f"at rest   {joint} moves most, {_length(strayed, unit, 4)}")
        return lines


class _Wave:
    """A joint whose reference may be a sinusoid.

    line: slope and offset of its acceleration over its position. most: largest distance from that
    line for it to be one.
    """

    def __init__(self, joint: str, line: tuple[float, float], most: float, unit: str) -> None:
        self._joint = joint
        self._unit = unit
        self._line = line
        self._most = most
        self._off = 0.0
        self._omega = float(np.sqrt(-line[0]))
        self._since = self._until = 0.0
        self._wanted, self._measured = _Phasor(self._omega), _Phasor(self._omega)

    def over_periods(self, after_s: float, last_s: float) -> bool:
        """Choose the whole periods between two times; return whether there is one."""
        period = 2 * np.pi / self._omega
        periods = int((last_s - after_s) / period + 1e-9)
        self._since, self._until = after_s, after_s + periods * period
        return periods >= 1

    def take(self, piece: Tracking) -> None:
        """Take the next piece of a recording."""
        reference, state = piece.reference_of(self._joint), piece.state_of(self._joint)
        if reference is None or state is None:
            return
        q, a = reference.of("position", self._joint), reference.of("acceleration", self._joint)
        measured = state.of("position", self._joint)
        if q is not None and a is not None and len(q):
            columns = np.column_stack((q, np.ones_like(q)))
            self._off = max(self._off, float(np.abs(columns @ self._line - a).max()))
        for phasor, t, values in (
            (self._wanted, reference.t, q),
            (self._measured, state.t, measured),
        ):
            if values is not None:
                chosen = (t >= self._since - 1e-9) & (t < self._until - 1e-9)
                phasor.take(t[chosen], values[chosen])

    def fit(self) -> SinusoidFit | None:
        """Return how the joint follows it; None where the reference is no sinusoid after all."""
        if self._off >= self._most:
            return None
        first, second = self._wanted.value(), self._measured.value()
        return SinusoidFit(
            joint=self._joint,
            wanted=abs(first),
            measured=abs(second),
            lag_s=float(np.angle(first / second)) / self._omega if second else float("nan"),
            unit=self._unit,
        )


class _Phasor:
    """Amplitude and phase of the part of a signal that has a frequency, as one number."""

    def __init__(self, omega: float) -> None:
        self._omega = omega
        self._span = _Span()
        self._waves = _LeastSquares()

    def take(self, t: Array, values: Array) -> None:
        angle = self._omega * t
        self._span.take(values)
        self._waves.take(
            np.column_stack((np.sin(angle), np.cos(angle), np.ones_like(angle))), values
        )

    def value(self) -> complex:
        if not 0.0 < self._span.width < np.inf:
            return complex(self._span.width and np.nan)
        sine, cosine, _ = self._waves.solution()
        return complex(sine, cosine)


def _amplitude(fit: SinusoidFit) -> str:
    wanted = _length(fit.wanted, fit.unit, 3)
    if not fit.measured:
        return f"did not move; its reference has {wanted}"
    measured = _length(fit.measured, fit.unit, 3)
    return f"{measured} of {wanted} ({100 * fit.excess:+.2f} %), lag {1e3 * fit.lag_s:.1f} ms"


def _length(value: float, unit: str, digits: int) -> str:
    """Return an angle in degrees, or a distance in m to a thousandth of a millimetre."""
    return f"{np.degrees(value):.{digits}f}°" if unit == "rad" else f"{value:.6f} m"
