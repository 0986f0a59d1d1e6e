"""Robots, read once from their model files: URDF, xacro and MJCF."""

from .description import Inertial as Inertial
from .description import Joint as Joint
from .description import Link as Link
from .description import Mimic as Mimic
from .description import Pose as Pose
from .description import RobotDescription as RobotDescription
from .description import Shape as Shape
from .read import read_robot as read_robot
from .urdf import is_file as is_file
from .urdf import mesh_unit as mesh_unit
from .write import urdf_text as urdf_text
