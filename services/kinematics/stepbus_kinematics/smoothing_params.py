"""Parameters that services which move joints share."""

from collections.abc import Iterator
from typing import Annotated, Literal

from stepbus_participant import Count, Positive, Settings, when
from stepbus_participant.parameters import Keys

Smoothing = Literal["none", "low_pass", "moving_average", "savitzky_golay"]
TimeConstant = Annotated[Positive, when(smoothing="low_pass")]
Window = Annotated[Count, when(smoothing=("moving_average", "savitzky_golay"))]


class SmoothingParams(Settings):
    """How measurements are smoothed."""

    smoothing: Smoothing = "none"
    """Filter of the measurements. The status reports its delay."""
    time_constant: TimeConstant
    """Time constant τ of the low-pass filter [s]."""
    window: Window
    """Window: an odd number of samples, at least 3 for the moving average and 5 for the
    Savitzky-Golay filter."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong with the window."""
        yield from window_problems(self.smoothing, self.window)


def window_problems(smoothing: Smoothing, window: int) -> Iterator[tuple[Keys, str]]:
    """Yield what is wrong with a number of samples."""
    least = {"moving_average": 3, "savitzky_golay": 5}.get(smoothing)
    if least is not None and window not in range(least, 1000, 2):
        yield ("window",), f"must be an odd number from {least} to 999, not {window}"
