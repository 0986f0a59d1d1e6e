"""The controller: from joint states and a reference to joint torques, by a law of your choice."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .params import Params

if TYPE_CHECKING:
    from .laws import LAWS, PD, PID, ComputedTorque, Law, PDGravity, Reference
    from .participant import ControllerParticipant
    from .robot import Robot

_MODULES = {
    "laws": ("LAWS", "PD", "PID", "ComputedTorque", "Law", "PDGravity", "Reference"),
    "participant": ("ControllerParticipant",),
    "robot": ("Robot",),
}
_WHERE = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "LAWS",
    "PD",
    "PID",
    "ComputedTorque",
    "ControllerParticipant",
    "Law",
    "PDGravity",
    "Params",
    "Reference",
    "Robot",
]


def __getattr__(name: str) -> Any:
    # The laws load Pinocchio; the parameters can be checked without.
    if name in _WHERE:
        return getattr(import_module(f".{_WHERE[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
