"""How well the joints follow their sinusoid, as a metric of sweeps: amplitude and lag."""

from typing import Any

import numpy as np

_SETTLED_S = 2.0


def sinusoid(recording: Any) -> dict[str, float | None]:
    """Return of each joint whose reference moves, by least squares over whole periods after 2 s.

    recording: with `mission.reference`, which gives accelerations, and `plant.joint_state`.
    `amplitude.JOINT`: measured over wanted one [1]. `lag.JOINT`: how far it is behind [s]; None
    for a joint that never moved.
    """
    wanted, measured = recording["mission/reference"], recording["plant/joint_state"]
    fits: dict[str, float | None] = {}
    for index, joint in enumerate(wanted.names):
        q, a = wanted["position"][:, index], wanted["acceleration"][:, index]
        if not np.ptp(q):
            continue
        # The acceleration of a sinusoid is −ω² times its distance from the centre.
        omega = float(np.sqrt(-np.polyfit(q, a, 1)[0]))
        own = measured["position"][:, list(measured.names).index(joint)]
        first, second = _phasor(wanted.t, q, omega), _phasor(measured.t, own, omega)
        fits[f"amplitude.{joint}"] = abs(second) / abs(first)
        fits[f"lag.{joint}"] = float(np.angle(first / second)) / omega if second else None
    return fits


def _phasor(t: Any, values: Any, omega: float) -> complex:
    """Return amplitude and phase of the part that has a frequency; t: [s]; omega: [rad/s]."""
    if not np.ptp(values):
        return 0j
    period = 2 * np.pi / omega
    periods = max(int((t[-1] - _SETTLED_S) / period + 1e-9), 1)
    chosen = (t >= _SETTLED_S - 1e-9) & (t < _SETTLED_S + periods * period - 1e-9)
    angle = omega * t[chosen]
    waves = np.column_stack((np.sin(angle), np.cos(angle), np.ones_like(angle)))
    sine, cosine, _ = np.linalg.lstsq(waves, values[chosen], rcond=None)[0]
    return complex(sine, cosine)
