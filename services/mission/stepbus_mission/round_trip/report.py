"""The report about the poses of a round trip."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median


@dataclass(frozen=True, kw_only=True)
class Trip:
    """The result of one pose.

    position_error [m], orientation_error [rad]: of the tip, measured by the plant. named: the
    controller's warning that the motors cannot hold the pose; empty: none. settled: whether it came
    to rest at the target.
    """

    position_error: float
    orientation_error: float
    named: str = ""
    settled: bool = True

    def is_good(self, position: float, orientation: float) -> bool:
        """Return whether it is within a tolerance [m, rad]."""
        return self.position_error <= position and self.orientation_error <= orientation

    def __str__(self) -> str:
        text = f"{self.position_error * 1e3:.3f} mm, {math.degrees(self.orientation_error):.4f}°"
        return text + ("" if self.settled else ", not settled")


def summary(
    arm: str, trips: Sequence[Trip], refused: Counter[str], position: float, orientation: float
) -> tuple[bool, str]:
    """Return whether exactly the named poses missed, and a sentence with the numbers.

    refused: cause → number of rejected poses. position [m], orientation [rad]: tolerance.
    """
    good = [trip for trip in trips if trip.is_good(position, orientation)]
    bad = [trip for trip in trips if not trip.is_good(position, orientation)]
    named = [trip for trip in trips if trip.named]
    unnamed_bad = sum(not trip.named for trip in bad)
    named_good = sum(trip.is_good(position, orientation) for trip in named)
    tolerance = f"{position * 1e3:g} mm and {math.degrees(orientation):.1f}°"
    parts = [f"{arm}: {len(good)} of {len(trips)} poses within {tolerance}"]
    if good:
        parts.append(_spread(good))
    parts.append(
        f"{len(named)} named not holdable beforehand, {len(named) - named_good} of them missed; "
        f"{unnamed_bad} missed without being named"
    )
    if refused:
        rows = ", ".join(f"{count} {cause}" for cause, count in sorted(refused.items()))
        parts.append(f"drawn and not gone to: {rows}")
    return not unnamed_bad and not named_good, "; ".join(parts)


def _spread(trips: Sequence[Trip]) -> str:
    positions = [trip.position_error * 1e3 for trip in trips]
    angles = [math.degrees(trip.orientation_error) for trip in trips]
    return (
        f"of these median {median(positions):.3f} mm and {median(angles):.4f}°, "
        f"worst {max(positions):.3f} mm and {max(angles):.4f}°"
    )
