"""Parameters that services which move joints share."""

from collections.abc import Iterator
from typing import Literal

from stepbus_participant import Count, Positive, Settings
from stepbus_participant.parameters import Keys

Smoothing = Literal["none", "low_pass", "moving_average", "savitzky_golay"]
_LEAST = {"moving_average": 3, "savitzky_golay": 5}


class SmoothingParams(Settings):
    """How measurements are smoothed."""

    smoothing: Smoothing = "none"
    """Filter of the measurements. The status reports its delay."""
    time_constant: Positive | None = None
    """Time constant τ of the low-pass filter [s]; with `smoothing: low_pass`, and only then."""
    window: Count | None = None
    """Window of the moving average and of the Savitzky-Golay filter, and only of these: an odd
    number of samples, at least 3 or 5."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield contradictions between the filter and its parameters."""
        yield from smoothing_problems(self.smoothing, self.time_constant, self.window)


def smoothing_problems(
    smoothing: Smoothing, time_constant: float | None, window: int | None
) -> Iterator[tuple[Keys, str]]:
    """Yield contradictions between a filter, its time constant [s] and its number of samples."""
    if (smoothing == "low_pass") != (time_constant is not None):
        yield ("time_constant",), "is needed with smoothing low_pass, and only then"
    least = _LEAST.get(smoothing)
    if (least is None) != (window is None):
        yield ("window",), f"is needed with smoothing {' or '.join(_LEAST)}, and only then"
    elif least is not None and window not in range(least, 1000, 2):
        yield ("window",), f"must be an odd number from {least} to 999, not {window}"
