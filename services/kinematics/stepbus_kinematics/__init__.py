"""Models of robots, and what services that move joints share."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .smoothing_params import Smoothing, SmoothingParams, smoothing_problems

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
    "Vector",
    "collision_geometry",
    "delay_warning",
    "joint_orders",
    "make_smoother",
    "radius_from",
    "smoothing_problems",
]

__getattr__ = imported_later(__name__, _WHERE)
