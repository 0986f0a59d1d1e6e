"""The parameters of the round trip of an arm."""

from collections.abc import Iterator

from stepbus_participant import Count, Finite, ModelFile, Positive, Settings, Text, suggest
from stepbus_participant.parameters import Keys


class Params(Settings):
    """Parameters of `stepbus_store.round_trip`."""

    model: ModelFile
    """URDF of the robot, from which poses are drawn."""
    prefix: str = ""
    """Prefix of this robot's link names in the plant, such as `left/` if two bodies from one
    URDF share a world."""
    frame: Text
    """Reference link of the poses."""
    arms: dict[str, Text]
    """Arm → its tip: the link that moves to the poses."""
    poses: Count
    """Number of poses per arm."""
    position_tolerance: Positive = 0.01
    """Position error above which a pose counts as missed [m]."""
    orientation_tolerance: Positive = 0.02
    """Orientation error above which a pose counts as missed [rad]."""
    home: dict[str, dict[str, Finite]] = {}
    """Arm → joint → position to return to after a missed pose, where its motors are overloaded
    [rad]."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield contradictions between arms and homes."""
        if not self.arms:
            yield ("arms",), "is empty"
        for arm in self.home:
            if arm not in self.arms:
                yield ("home", arm), f"is not an arm{suggest(arm, self.arms)}"
