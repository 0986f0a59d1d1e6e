"""What a process imports to take part in a run."""

from stepbus_schemas import (
    BaseCommand,
    BaseState,
    Contacts,
    ControllerStatus,
    Description,
    Detections,
    Event,
    Goal,
    GoalStatus,
    GripperCommand,
    GripperState,
    Image,
    JointCommand,
    JointReference,
    JointState,
    Message,
    MessageError,
    Plan,
    PlanRequest,
    Poses,
    RunError,
    StepbusError,
    WiringError,
)

from .bus import Bus, BusError
from .calls import CallError, Verb
from .config import Config
from .main import main, take_part
from .outbox import OutputError
from .participant import Participant
from .step import InputAbsent, Step
from .ticket import Endpoint, Ticket, load_ticket

__all__ = [
    "BaseCommand",
    "BaseState",
    "Bus",
    "BusError",
    "CallError",
    "Config",
    "Contacts",
    "ControllerStatus",
    "Description",
    "Detections",
    "Endpoint",
    "Event",
    "Goal",
    "GoalStatus",
    "GripperCommand",
    "GripperState",
    "Image",
    "InputAbsent",
    "JointCommand",
    "JointReference",
    "JointState",
    "Message",
    "MessageError",
    "OutputError",
    "Participant",
    "Plan",
    "PlanRequest",
    "Poses",
    "RunError",
    "Step",
    "StepbusError",
    "Ticket",
    "Verb",
    "WiringError",
    "load_ticket",
    "main",
    "take_part",
]
