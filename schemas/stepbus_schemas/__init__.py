"""The contract of stepbus: message types, protocol envelopes and their codec.

What only schemas, tables, vectors and the bridge need is imported when it is first used: each
participant is a process, and loads this at every start.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from stepbus_schemas.codec import (
    UNDECODABLE,
    Decoder,
    Shape,
    encode,
    encoding_of,
    message_class,
    parse_shapes,
    type_name,
)
from stepbus_schemas.messages import *

from .errors import MessageError, RunError, StepbusError, WiringError
from .protocol import *
from .schedule import due_step
from .types import SHIPPED, Types, class_declaration, declaration_of, type_problems
from .types.decode_errors import explained
from .words import error_text, text_of, valid_unicode

if TYPE_CHECKING:
    from stepbus_schemas.bridge import (
        BRIDGE_FORMATS,
        BridgeFormat,
        RawField,
        RawLayout,
        raw_fields,
        raw_problem,
    )
    from stepbus_schemas.schema import field_docstrings, json_schema, not_null
    from stepbus_schemas.tables import raw_table, types_page
    from stepbus_schemas.vectors import types_vectors

    from .types.units import unit_problem

_MODULES = {
    "bridge": (
        "BRIDGE_FORMATS",
        "BridgeFormat",
        "RawField",
        "RawLayout",
        "raw_fields",
        "raw_problem",
    ),
    "schema": ("field_docstrings", "json_schema", "not_null"),
    "tables": ("raw_table", "types_page"),
    "vectors": ("types_vectors",),
    "types.units": ("unit_problem",),
}
_WHERE = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "BRIDGE_FORMATS",
    "CHAIN_EVERY",
    "ENVELOPE_TYPES",
    "HANDSHAKE_STEP",
    "MESSAGE_TYPES",
    "PROTOCOL_VERSION",
    "SHIPPED",
    "UNDECODABLE",
    "BaseCommand",
    "BaseState",
    "Batch",
    "BridgeFormat",
    "BytesMessage",
    "Call",
    "CallDescription",
    "CallRecord",
    "CallReply",
    "CallRequest",
    "Called",
    "Chain",
    "Contacts",
    "ControllerStatus",
    "Decoder",
    "Description",
    "Detections",
    "Envelope",
    "Event",
    "Fault",
    "Goal",
    "GoalState",
    "GoalStatus",
    "GoalType",
    "GripperCommand",
    "GripperState",
    "Hello",
    "Image",
    "Imu",
    "InputConfig",
    "JointCommand",
    "JointMode",
    "JointReference",
    "JointState",
    "LaserScan",
    "Log",
    "Message",
    "MessageError",
    "OutputConfig",
    "Outputs",
    "Plan",
    "PlanRequest",
    "Point",
    "PointCloud",
    "Poses",
    "Quaternion",
    "RawField",
    "RawLayout",
    "Ready",
    "Refusal",
    "RunError",
    "Scalars",
    "SensedJoints",
    "Shape",
    "Spiral",
    "Start",
    "StepbusError",
    "Stop",
    "TextMessage",
    "Transforms",
    "Trigger",
    "Types",
    "Waiting",
    "Welcome",
    "WiringError",
    "Wrench",
    "class_declaration",
    "declaration_of",
    "due_step",
    "encode",
    "encoding_of",
    "error_text",
    "explained",
    "field_docstrings",
    "json_schema",
    "message_class",
    "meta",
    "not_null",
    "parse_shapes",
    "raw_fields",
    "raw_problem",
    "raw_table",
    "text_of",
    "type_name",
    "type_problems",
    "types_page",
    "types_vectors",
    "unit_problem",
    "valid_unicode",
]


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        return getattr(import_module(f".{_WHERE[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
