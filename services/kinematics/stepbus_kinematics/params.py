"""Parameters that services which move joints share."""

from collections.abc import Iterator
from typing import Annotated, Literal

from stepbus_participant import Count, Positive, Settings, when
from stepbus_participant.parameters import Keys

Smoothing = Literal["none", "low_pass", "savitzky_golay"]
TimeConstant = Annotated[Positive, when(smoothing="low_pass")]
Window = Annotated[Count, when(smoothing="savitzky_golay")]


class SmoothingParams(Settings):
    """How measurements are smoothed."""

    smoothing: Smoothing = "none"
    """Filter of the measurements; the status reports its delay."""
    time_constant: TimeConstant
    """τ of the low pass [s]."""
    window: Window
    """Samples of the Savitzky-Golay filter, an odd number from 5 on."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong with the window."""
        yield from window_problems(self.smoothing, self.window)


def window_problems(smoothing: Smoothing, window: int) -> Iterator[tuple[Keys, str]]:
    """Yield what is wrong with a number of samples."""
    is_odd = window in range(5, 1000) and window % 2 == 1
    if smoothing == "savitzky_golay" and not is_odd:
        yield ("window",), f"must be an odd number from 5 to 999, not {window}"
