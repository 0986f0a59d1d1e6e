"""One wrapper of a Pinocchio model, and what services that move joints share.

What loads Pinocchio is imported when it is first used: parameters are checked without.
"""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Smoothing, SmoothingParams, TimeConstant, Window, window_problems

if TYPE_CHECKING:
    from .geometry import collision_geometry, radius_from
    from .joint_order import JointOrder, joint_orders
    from .model import Indices, Overload, RobotModel, Vector
    from .self_collisions import LinkPair, SelfCollisions
    from .smoothing import Smoother, delay_warning, make_smoother

_MODULES = {
    "geometry": ("collision_geometry", "radius_from"),
    "joint_order": ("JointOrder", "joint_orders"),
    "model": ("Indices", "Overload", "RobotModel", "Vector"),
    "self_collisions": ("LinkPair", "SelfCollisions"),
    "smoothing": ("Smoother", "delay_warning", "make_smoother"),
}
_WHERE = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
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
