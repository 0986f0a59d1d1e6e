"""One wrapper of a Pinocchio model, and what services that move joints share."""

from .geometry import collision_geometry, keep_moving_pairs, radius_from
from .joint_order import JointOrder
from .model import STANDARD_GRAVITY, Indices, Overload, RobotModel, Vector
from .self_collisions import LinkPair, SelfCollisions
from .smoothing import LowPass, SavitzkyGolay, Smoother, delay_warning, read_smoother

__all__ = [
    "STANDARD_GRAVITY",
    "Indices",
    "JointOrder",
    "LinkPair",
    "LowPass",
    "Overload",
    "RobotModel",
    "SavitzkyGolay",
    "SelfCollisions",
    "Smoother",
    "Vector",
    "collision_geometry",
    "delay_warning",
    "keep_moving_pairs",
    "radius_from",
    "read_smoother",
]
