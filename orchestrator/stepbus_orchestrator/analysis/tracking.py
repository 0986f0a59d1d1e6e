"""How well joints follow their reference, summed up piece by piece."""

import numpy as np

from .signals import Tracking


class TrackingError:
    """The root mean square of each joint's tracking error.

    after_s: what comes before is left out [s]. The closing sample has no reference and is left
    out too. Of a recording in several pieces the sum may differ from that in one in the last
    digits of a double.
    """

    def __init__(self, after_s: float) -> None:
        self._after_s = after_s
        self._sums: dict[str, tuple[float, int]] = {}

    def take(self, piece: Tracking) -> None:
        """Take the next piece of a recording."""
        for joint in piece.joints:
            state = piece.state_of(joint)
            error = piece.error(joint)
            if state is not None:
                error = error[state.t >= self._after_s]
            total, count = self._sums.get(joint, (0.0, 0))
            known = int(np.count_nonzero(~np.isnan(error)))
            # A simulation that diverges leaves numbers whose squares are too large for any.
            with np.errstate(over="ignore"):
                squares = float(np.nansum(error**2))
            self._sums[joint] = (total + squares, count + known)

    def rmse(self) -> dict[str, float]:
        """Return joint → root mean square [rad or m]; none for a joint without a reference."""
        return {
            joint: float(np.sqrt(total / count))
            for joint, (total, count) in self._sums.items()
            if count
        }


def tracking_rmse(tracking: Tracking, after_s: float = 2.0) -> dict[str, float]:
    """Return the root mean square of each joint's tracking error in one piece [rad or m]."""
    error = TrackingError(after_s)
    error.take(tracking)
    return error.rmse()
