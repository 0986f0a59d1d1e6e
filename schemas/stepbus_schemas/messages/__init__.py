"""Version 1 of the port messages.

SI units throughout. Every vector is in the order of `names` in the port's description. A field may
be added with a default; any other change is a new major version, a class of its own.
"""

from .base import *
from .robot import *
from .sensors import *

__all__ = [
    "MESSAGE_TYPES",
    "BaseCommand",
    "BaseState",
    "BytesMessage",
    "CameraTrigger",
    "Contacts",
    "ControllerStatus",
    "Detections",
    "EmergencyStop",
    "Event",
    "Goal",
    "GoalState",
    "GoalStatus",
    "GoalType",
    "GripperCommand",
    "GripperState",
    "Image",
    "Imu",
    "JointCommand",
    "JointMode",
    "JointReference",
    "JointState",
    "LaserScan",
    "Message",
    "Plan",
    "PlanRequest",
    "Point",
    "PointCloud",
    "Poses",
    "Quaternion",
    "Scalars",
    "SensedJoints",
    "Spiral",
    "TextMessage",
    "Transforms",
    "Wrench",
    "meta",
]

MESSAGE_TYPES: dict[str, type[Message]] = dict(
    sorted(
        (cls.TYPE or f"{cls.__name__.removesuffix('Message')}/1", cls)
        for cls in Message.__subclasses__()
    )
)
"""Name → class of every type that ships."""
