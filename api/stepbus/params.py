"""Parameters of a participant: types of what its `Settings` declare."""

from typing import TYPE_CHECKING

from .lookup import imported_on_use

if TYPE_CHECKING:
    from stepbus_participant import (
        Count,
        Duration,
        File,
        Finite,
        ModelFile,
        Name,
        Names,
        NonNegative,
        NonNegativePerJoint,
        PerJoint,
        PerName,
        Plugin,
        Positive,
        PositivePerJoint,
        Settings,
        Share,
        Text,
        Vector3,
        Whole,
        each,
        needed_when,
        when,
    )

__all__ = [
    "Count",
    "Duration",
    "File",
    "Finite",
    "ModelFile",
    "Name",
    "Names",
    "NonNegative",
    "NonNegativePerJoint",
    "PerJoint",
    "PerName",
    "Plugin",
    "Positive",
    "PositivePerJoint",
    "Settings",
    "Share",
    "Text",
    "Vector3",
    "Whole",
    "each",
    "needed_when",
    "when",
]

__getattr__, __dir__ = imported_on_use(__name__, __all__, ("stepbus_participant",))
