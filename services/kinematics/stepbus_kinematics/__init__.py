"""Models of robots, and what services that move joints share."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .smoothing_params import Smoothing as Smoothing
from .smoothing_params import SmoothingParams as SmoothingParams
from .smoothing_params import smoothing_problems as smoothing_problems

if TYPE_CHECKING:
    from .joint_order import JointOrder as JointOrder
    from .joint_order import joint_orders as joint_orders
    from .model import Indices as Indices
    from .model import Overload as Overload
    from .model import RobotModel as RobotModel
    from .model import Vector as Vector
    from .self_collisions import LinkPair as LinkPair
    from .self_collisions import SelfCollisions as SelfCollisions
    from .self_collisions import collision_geometry as collision_geometry
    from .self_collisions import radius_from as radius_from
    from .smoothing import Differentiator as Differentiator
    from .smoothing import Smoother as Smoother
    from .smoothing import delay_warning as delay_warning
    from .smoothing import make_smoother as make_smoother

_MODULES = {
    "joint_order": ("JointOrder", "joint_orders"),
    "model": ("Indices", "Overload", "RobotModel", "Vector"),
    "self_collisions": ("LinkPair", "SelfCollisions", "collision_geometry", "radius_from"),
    "smoothing": ("Differentiator", "Smoother", "delay_warning", "make_smoother"),
}

__getattr__ = imported_later(
    __name__, {name: module for module, names in _MODULES.items() for name in names}
)
