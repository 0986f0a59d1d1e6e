"""Parameters that services which move joints share."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from stepbus_participant import Count, Positive, Settings, imported_later, when
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


if TYPE_CHECKING:
    from stepbus_kinematics.joint_order import JointOrder, joint_orders
    from stepbus_kinematics.model import Indices, Overload, RobotModel, Vector
    from stepbus_kinematics.self_collisions import (
        LinkPair,
        SelfCollisions,
        collision_geometry,
        radius_from,
    )
    from stepbus_kinematics.smoothing import (
        Differentiator,
        Smoother,
        delay_warning,
        make_smoother,
    )

_MODULES = {
    "joint_order": ("JointOrder", "joint_orders"),
    "model": ("Indices", "Overload", "RobotModel", "Vector"),
    "self_collisions": ("LinkPair", "SelfCollisions", "collision_geometry", "radius_from"),
    "smoothing": ("Differentiator", "Smoother", "delay_warning", "make_smoother"),
}
_WHERE = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "Differentiator",
    "Indices",
    "JointOrder",
    "LinkPair",
    "Overload",
    "RobotModel",
    "SelfCollisions",
    "Smoother",
    "Smoothing",
    "SmoothingParams",
    "TimeConstant",
    "Vector",
    "Window",
    "collision_geometry",
    "delay_warning",
    "joint_orders",
    "make_smoother",
    "radius_from",
    "window_problems",
]

__getattr__ = imported_later(__name__, _WHERE)
