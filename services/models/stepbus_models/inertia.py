"""Inertias that no body can have, replaced by one that all engines compute with alike.

Such an inertia is 0 for PyBullet, refused or balanced by MuJoCo, and taken as it is by Pinocchio.
"""

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
    least, middle, largest = sorted(given[:3])
    if not any(given[3:]) and least >= 0.0 and largest <= least + middle:
        return given, ""
    repaired = _repaired(given)
    change = max(abs(new - old) for new, old in zip(repaired, given, strict=True))
    if change <= max(_NOISE, _SILENT * largest):
        return repaired, ""
    text = (
        f"no body can have the inertia {_shown(given)} kg·m²: a principal moment is negative or "
        f"exceeds the sum of the other two; {_shown(repaired)} is used"
    )
    return repaired, text


def _repaired(inertia: Moments) -> Moments:
    import numpy as np  # noqa: PLC0415  few robots need it

    xx, yy, zz, xy, xz, yz = inertia
    values, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    excess, largest = values[2] - values[0] - values[1], values[2]
    if values[0] < -_DIGITS * largest or excess > _DIGITS * largest:
        mean = (xx + yy + zz) / 3
        return mean, mean, mean, 0.0, 0.0, 0.0
    # Each engine turns it into its principal axes by itself, and must not arrive beyond the limit.
    # What is returned below stays as it is when it is read again, however a processor rounds.
    if values[0] >= 0.0 and excess < -_MARGIN / 2 * largest:
        return inertia
    values[0] = max(values[0], 0.0)
    values[2] = min(largest, (values[0] + values[1]) * (1.0 - _MARGIN))
    full = (axes @ np.diag(values) @ axes.T).tolist()
    return full[0][0], full[1][1], full[2][2], full[0][1], full[0][2], full[1][2]


def _shown(inertia: Moments) -> str:
    """Return the moments, with the products where there are any."""
    count = 6 if any(inertia[3:]) else 3
    return f"({', '.join(f'{value:.7g}' for value in inertia[:count])})"
