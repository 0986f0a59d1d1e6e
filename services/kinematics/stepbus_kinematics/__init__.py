"""Models of robots, joint orders and collision checks, for services that move joints."""

from .joint_order import JointOrder as JointOrder
from .joint_order import joint_orders as joint_orders
from .model import Indices as Indices
from .model import Overload as Overload
from .model import RobotModel as RobotModel
from .model import Values as Values
from .model import Vector as Vector
from .self_collisions import LinkPair as LinkPair
from .self_collisions import SelfCollisions as SelfCollisions
from .self_collisions import collision_geometry as collision_geometry
from .self_collisions import radius_from as radius_from
