"""The controller: from joint states and a reference to joint torques, by a law of your choice."""

from .laws import LAWS, PD, PID, ComputedTorque, Law, PDGravity, Reference
from .participant import ControllerParticipant
from .robot import Robot

__all__ = [
    "LAWS",
    "PD",
    "PID",
    "ComputedTorque",
    "ControllerParticipant",
    "Law",
    "PDGravity",
    "Reference",
    "Robot",
]
