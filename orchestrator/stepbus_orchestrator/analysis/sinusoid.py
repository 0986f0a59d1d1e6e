"""How well joints follow a sinusoid: amplitude and lag, and whether the others stand still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .signals import Array, Signal, Tracking

# The acceleration of a sinusoid is −ω² times its distance from the centre; to this precision.
_IS_SINUSOID = 1e-6


@dataclass(frozen=True, kw_only=True)
class SinusoidFit:
    """One joint that follows a sinusoid.

    wanted, measured: amplitudes [rad]. lag_s: how far the measured one is behind [s]; NaN for a
    joint that never moved.
    """

    joint: str
    wanted: float
    measured: float
    lag_s: float

    @property
    def excess(self) -> float:
        """Return by how much the measured amplitude is too large, relative to the wanted one."""
        return self.measured / self.wanted - 1.0


def fit_sinusoids(tracking: Tracking, after_s: float) -> list[SinusoidFit]:
    """Return a fit for every joint whose reference is a sinusoid, over whole periods.

    after_s: what comes before is left out [s].
    """
    fits = (_fit(tracking, joint, after_s) for joint in tracking.joints)
    return [fit for fit in fits if fit is not None]


def _fit(tracking: Tracking, joint: str, after_s: float) -> SinusoidFit | None:
    state, reference = tracking.state, tracking.reference
    if state is None or reference is None:
        return None
    omega = _omega(reference, joint)
    wanted, measured = reference.of("position", joint), state.of("position", joint)
    if omega is None or wanted is None or measured is None:
        return None
    period = 2 * np.pi / omega
    periods = int((state.t[-1] - after_s) / period + 1e-9)
    if periods < 1:
        return None
    until = after_s + periods * period
    first = _phasor(reference.t, wanted, omega, after_s, until)
    second = _phasor(state.t, measured, omega, after_s, until)
    return SinusoidFit(
        joint=joint,
        wanted=abs(first),
        measured=abs(second),
        lag_s=float(np.angle(first / second)) / omega if second else float("nan"),
    )


def _omega(reference: Signal, joint: str) -> float | None:
    """Return the angular frequency of a reference that is a sinusoid [rad/s], or None."""
    q, a = reference.of("position", joint), reference.of("acceleration", joint)
    if q is None or a is None or len(q) < 4 or np.ptp(q) == 0.0 or np.ptp(a) == 0.0:
        return None
    columns = np.column_stack((q, np.ones_like(q)))
    slope, offset = np.linalg.lstsq(columns, a, rcond=None)[0]
    residual = np.abs(columns @ (slope, offset) - a).max()
    return float(np.sqrt(-slope)) if slope < 0 and residual < _IS_SINUSOID * np.ptp(a) else None


def _phasor(t: Array, q: Array, omega: float, since: float, until: float) -> complex:
    """Return amplitude and phase of the part of a signal that has a frequency, as one number."""
    chosen = (t >= since - 1e-9) & (t < until - 1e-9)
    if np.ptp(q[chosen]) == 0.0:
        return 0j
    angle = omega * t[chosen]
    columns = np.column_stack((np.sin(angle), np.cos(angle), np.ones_like(angle)))
    sine, cosine, _ = np.linalg.lstsq(columns, q[chosen], rcond=None)[0]
    return complex(sine, cosine)


def motion_at_rest(tracking: Tracking) -> tuple[str, float] | None:
    """Return which of the joints that should stand still moves most, and how far [rad]."""
    state, reference = tracking.state, tracking.reference
    if state is None or reference is None:
        return None
    rows = []
    for joint in tracking.joints:
        wanted, measured = reference.of("position", joint), state.of("position", joint)
        if wanted is not None and measured is not None and np.ptp(wanted) == 0.0:
            rows.append((joint, float(np.abs(measured - measured[0]).max())))
    return max(rows, key=lambda row: row[1], default=None)


def sinusoid_lines(tracking: Tracking, after_s: float) -> list[str]:
    """Return what a summary says of the joints that follow a sinusoid, angles in degrees."""
    fits = fit_sinusoids(tracking, after_s)
    lines = [f"sinusoid  {fit.joint}: {_amplitude(fit)}" for fit in fits]
    still = motion_at_rest(tracking)
    if fits and still is not None:
        joint, angle = still
        lines.append(f"at rest   {joint} moves most, {np.degrees(angle):.4f}°")
    return lines


def _amplitude(fit: SinusoidFit) -> str:
    wanted = f"{np.degrees(fit.wanted):.3f}°"
    if not fit.measured:
        return f"did not move; its reference has {wanted}"
    measured = f"{np.degrees(fit.measured):.3f}°"
    return f"{measured} of {wanted} ({100 * fit.excess:+.2f} %), lag {1e3 * fit.lag_s:.1f} ms"
