"""Messages of all types that ship, and what declares types of your own."""

from typing import TYPE_CHECKING

from .lookup import imported_on_use

if TYPE_CHECKING:
    from stepbus_participant import load_types
    from stepbus_schemas import (
        BaseCommand,
        BaseState,
        BytesMessage,
        Contacts,
        ControllerStatus,
        Detections,
        Event,
        Goal,
        GoalStatus,
        GripperCommand,
        GripperState,
        Image,
        Imu,
        JointCommand,
        JointReference,
        JointState,
        LaserScan,
        Message,
        Plan,
        PlanRequest,
        PointCloud,
        Poses,
        Scalars,
        SensedJoints,
        Spiral,
        TextMessage,
        Transforms,
        Types,
        Wrench,
        meta,
    )

__all__ = [
    "BaseCommand",
    "BaseState",
    "BytesMessage",
    "Contacts",
    "ControllerStatus",
    "Detections",
    "Event",
    "Goal",
    "GoalStatus",
    "GripperCommand",
    "GripperState",
    "Image",
    "Imu",
    "JointCommand",
    "JointReference",
    "JointState",
    "LaserScan",
    "Message",
    "Plan",
    "PlanRequest",
    "PointCloud",
    "Poses",
    "Scalars",
    "SensedJoints",
    "Spiral",
    "TextMessage",
    "Transforms",
    "Types",
    "Wrench",
    "load_types",
    "meta",
]

__getattr__, __dir__ = imported_on_use(
    __name__, __all__, ("stepbus_schemas", "stepbus_participant")
)
