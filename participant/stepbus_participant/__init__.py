"""What a process imports to take part in a run."""

from .bus import ONE_THREAD, Bus, BusError, FaultyPublisher, LoopbackBus, Queue, Request, ZenohBus
from .bus.ticket import (
    TICKET_VARIABLE,
    Endpoint,
    MessageFault,
    ProfileOrder,
    Ticket,
    load_ticket,
    scratch_folder,
)
from .calls.methods import CallError, Method
from .calls.steering import Steering
from .config import Config, Ports
from .config.plugins import make_plugin
from .files import (
    Mimic,
    find_file,
    last_error,
    mimics,
    package_path,
    parse_urdf,
    read_urdf_text,
    urdf_warnings,
)
from .hints.extras import ExtraMissing, extra_hint, import_error_hint, install_command, need
from .hints.suggestions import suggest
from .parameters.durations import LONGEST_NS, format_duration, parse_duration
from .parameters.problems import Problems, SettingsError
from .parameters.settings import *
from .parameters.types_file import load_types
from .participant import Participant, PortType
from .process.hosting import HOST, Host
from .process.main import main, take_part
from .session import Input, OutputError, read_stamp, stamp
from .step import InputAbsent, InvalidInput, Step

__all__ = [
    "HOST",
    "LONGEST_NS",
    "ONE_THREAD",
    "TICKET_VARIABLE",
    "Bus",
    "BusError",
    "CallError",
    "Config",
    "Count",
    "Duration",
    "Endpoint",
    "ExtraMissing",
    "FaultyPublisher",
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
    "Text",
    "Ticket",
    "Vector3",
    "Whole",
    "ZenohBus",
    "each",
    "extra_hint",
    "find_file",
    "format_duration",
    "import_error_hint",
    "install_command",
    "last_error",
    "load_ticket",
    "load_types",
    "main",
    "make_plugin",
    "mimics",
    "need",
    "needed_when",
    "package_path",
    "parse_duration",
    "parse_urdf",
    "read_stamp",
    "read_urdf_text",
    "scratch_folder",
    "stamp",
    "suggest",
    "take_part",
    "urdf_warnings",
    "when",
]
