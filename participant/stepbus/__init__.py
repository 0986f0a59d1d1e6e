"""What a process imports to take part in a run."""

from stepbus_schemas import (
    ControllerStatus,
    Description,
    Event,
    Goal,
    GoalStatus,
    JointCommand,
    JointReference,
    JointState,
    Message,
    MessageError,
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
    "Bus",
    "BusError",
    "CallError",
    "Config",
    "ControllerStatus",
    "Description",
    "Endpoint",
    "Event",
    "Goal",
    "GoalStatus",
    "InputAbsent",
    "JointCommand",
    "JointReference",
    "JointState",
    "Message",
    "MessageError",
    "OutputError",
    "Participant",
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
