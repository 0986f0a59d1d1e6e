"""The parameters of the round trip of an arm."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from stepbus_participant import (
    Count,
    Finite,
    ModelFile,
    Positive,
    Settings,
    Text,
    imported_later,
    suggest,
)
from stepbus_participant.parameters import Keys


class Params(Settings):
    """Parameters of `stepbus_mission.round_trip`."""

    model: ModelFile
    """URDF from which to draw poses."""
    prefix: str = ""
    """Prefix that the plant adds to the link names of this robot: `left/` where two bodies of one
    URDF share a world."""
    frame: Text
    """Link that is the reference frame of the poses."""
    arms: dict[str, Text]
    """Arm → its tip: the link that moves to the poses."""
    poses: Count
    """Number of poses per arm."""
    position_tolerance: Positive = 0.01
    """Position error from which a pose counts as missed [m]."""
    orientation_tolerance: Positive = 0.02
    """Orientation error from which a pose counts as missed [rad]."""
    home: dict[str, dict[str, Finite]] = {}
    """Arm → joint → position to return to after a missed pose, at which the motors are overloaded
    [rad]."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield contradictions between arms and homes."""
        if not self.arms:
            yield ("arms",), "is empty"
        for arm in self.home:
            if arm not in self.arms:
                yield ("home", arm), f"is no arm{suggest(arm, self.arms)}"


if TYPE_CHECKING:
    from stepbus_mission.round_trips import RoundTrip

__all__ = ["Params", "RoundTrip"]

__getattr__ = imported_later("stepbus_mission", {"RoundTrip": "round_trips"})
