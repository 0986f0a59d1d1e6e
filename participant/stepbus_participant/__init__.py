"""What a process imports to take part in a run.

What only some participants need, such as models of robots, is imported when it is first used:
each is a process, and loads this at every start.
"""

from typing import TYPE_CHECKING

from .bus import ONE_THREAD, Bus, BusError, Clock, Queue, Request, ZenohBus
from .bus.ticket import (
    NO_CHECKPOINTS,
    TICKET_VARIABLE,
    CheckpointOrder,
    Endpoint,
    MessageFault,
    ProfileOrder,
    Ticket,
    load_ticket,
    scratch_folder,
)
from .calls import CallError, Method, Steering
from .config import Config, Ports, load_class, make_plugin
from .disk import Disk, NewFile, make_file, write_at, write_file
from .files import (
    append_to,
    find_file,
    irregular,
    is_shared,
    last_error,
    make_folder,
    make_new_folder,
    open_regular,
    package_path,
    read_file,
    read_text,
)
from .hints import (
    ExtraMissing,
    extra_hint,
    import_error_hint,
    imported_later,
    install_command,
    installed_version,
    need,
    suggest,
)
from .parameters.problems import Problems, SettingsError
from .parameters.settings import *
from .parameters.settings import LONGEST_NS, Own, format_duration, parse_duration, whole_steps
from .participant import InputAbsent, InvalidInput, Participant, PortType, Step, StepsOver
from .process import (
    HOST,
    PARTICIPANTS,
    Host,
    declared_parameters,
    import_participant,
    is_installed,
    is_ours,
    main,
    take_part,
)
from .session import Input, OutputError, read_stamp, stamp

if TYPE_CHECKING:
    from .bus.loopback import LoopbackBus
    from .parameters.types_file import load_types
    from .urdf import read_urdf_text, urdf_warnings
    from .urdf_check import Mimic, mimics, parse_urdf

_MODULES = {
    "bus.loopback": ("LoopbackBus",),
    "urdf": ("read_urdf_text", "urdf_warnings"),
    "urdf_check": ("Mimic", "mimics", "parse_urdf"),
    "parameters.types_file": ("load_types",),
}
_WHERE = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "HOST",
    "LONGEST_NS",
    "NO_CHECKPOINTS",
    "ONE_THREAD",
    "PARTICIPANTS",
    "TICKET_VARIABLE",
    "Bus",
    "BusError",
    "CallError",
    "CheckpointOrder",
    "Clock",
    "Config",
    "Count",
    "Disk",
    "Duration",
    "Endpoint",
    "ExtraMissing",
    "File",
    "Finite",
    "Host",
    "Input",
    "InputAbsent",
    "InvalidInput",
    "LoopbackBus",
    "MessageFault",
    "Method",
    "Mimic",
    "ModelFile",
    "Name",
    "Names",
    "NewFile",
    "NonNegative",
    "NonNegativePerJoint",
    "OutputError",
    "Own",
    "Participant",
    "PerJoint",
    "PerName",
    "Plugin",
    "PortType",
    "Ports",
    "Positive",
    "PositivePerJoint",
    "Problems",
    "ProfileOrder",
    "Queue",
    "Request",
    "Settings",
    "SettingsError",
    "Share",
    "Steering",
    "Step",
    "StepsOver",
    "Text",
    "Ticket",
    "Vector3",
    "Whole",
    "ZenohBus",
    "append_to",
    "declared_parameters",
    "each",
    "extra_hint",
    "find_file",
    "format_duration",
    "import_error_hint",
    "import_participant",
    "imported_later",
    "install_command",
    "installed_version",
    "irregular",
    "is_installed",
    "is_ours",
    "is_shared",
    "last_error",
    "load_class",
    "load_ticket",
    "load_types",
    "main",
    "make_file",
    "make_folder",
    "make_new_folder",
    "make_plugin",
    "mimics",
    "need",
    "needed_when",
    "open_regular",
    "package_path",
    "parse_duration",
    "parse_urdf",
    "read_file",
    "read_stamp",
    "read_text",
    "read_urdf_text",
    "scratch_folder",
    "stamp",
    "suggest",
    "take_part",
    "urdf_warnings",
    "when",
    "whole_steps",
    "write_at",
    "write_file",
]

__getattr__ = imported_later(__name__, _WHERE)
