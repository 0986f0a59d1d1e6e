"""Inertias that no body can have, replaced by one that all engines compute with alike.

Such an inertia is 0 for PyBullet, refused or balanced by MuJoCo, and taken as it is by Pinocchio.
"""

from collections.abc import Sequence

from .description import Moments

_DIGITS = 1e-3
"""By which a moment of three digits may exceed that of a body, as a share of the largest."""
_MARGIN = 1e-9
_NOISE = 1e-12
"""Rounding errors of the program that wrote the moments [kg·m²]."""
_SILENT = 1e-6
"""A change that is not worth a warning, as a share of the largest moment."""


def balanced(given: Moments) -> tuple[Moments, str]:
    """Return the moments of a body near those given, and a warning; it is empty for rounding.

    A third of the trace about every axis, as by MuJoCo's `balanceinertia`, or the moments of a
    plate where the given ones are only rounded.
    """
    repaired = _turned(given) if any(given[3:]) else _straight(given)
    change = max(abs(new - old) for new, old in zip(repaired, given, strict=True))
    if change <= max(_NOISE, _SILENT * max(given[:3])):
        return repaired, ""
    text = (
        f"no body can have the inertia {_shown(given)} kg·m²: a principal moment is negative or "
        f"exceeds the sum of the other two; {_shown(repaired)} is used"
    )
    return repaired, text


def _shown(inertia: Moments) -> str:
    """Return the moments, with the products where there are any."""
    count = 6 if any(inertia[3:]) else 3
    return f"({', '.join(f'{value:.7g}' for value in inertia[:count])})"


def _mean(inertia: Sequence[float]) -> Moments:
    mean = sum(inertia[:3]) / 3
    return mean, mean, mean, 0.0, 0.0, 0.0


def _straight(inertia: Moments) -> Moments:
    """Return the moments of a body near an inertia without products."""
    least, middle, largest = sorted(inertia[:3])
    # Engines compare exactly, and reject a plate whose moments are rounded.
    if largest <= least + middle:
        return inertia
    if largest - least - middle > _DIGITS * largest:
        return _mean(inertia)
    xx, yy, zz = (min(value, least + middle) for value in inertia[:3])
    return xx, yy, zz, 0.0, 0.0, 0.0


def _turned(inertia: Moments) -> Moments:
    """Return the moments of a body near an inertia with products."""
    import numpy as np  # noqa: PLC0415  few robots need it

    xx, yy, zz, xy, xz, yz = inertia
    values, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    excess, largest = values[2] - values[0] - values[1], values[2]
    if values[0] < -_DIGITS * largest or excess > _DIGITS * largest:
        return _mean(inertia)
    # Each engine turns it into its principal axes by itself, and must not arrive beyond the limit.
    if values[0] >= 0.0 and excess < -_MARGIN * largest:
        return inertia
    values[0] = max(values[0], 0.0)
    values[2] = min(largest, (values[0] + values[1]) * (1.0 - _MARGIN))
    full = (axes @ np.diag(values) @ axes.T).tolist()
    return full[0][0], full[1][1], full[2][2], full[0][1], full[0][2], full[1][2]
