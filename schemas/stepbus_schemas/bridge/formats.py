"""The formats that the bridge speaks to a program (docs/guide/writing/bridge.md)."""

from collections.abc import Mapping
from typing import Literal, get_args

from stepbus_schemas.types import SHIPPED, Types

from .raw_layout import raw_fields

BridgeFormat = Literal["json", "msgpack", "raw"]

BRIDGE_FORMATS: tuple[str, ...] = get_args(BridgeFormat)


def raw_problem(
    publishes: str,
    inputs: Mapping[str, str],
    outputs: Mapping[str, str],
    types: Types = SHIPPED,
) -> str:
    """Return why format `raw` cannot carry a participant; empty where it can.

    inputs, outputs: port → message type. types: of the scenario.
    """
    if publishes == "first":
        return "raw cannot publish first; use json or msgpack"
    ports = [*inputs.items(), *outputs.items()]
    others = [
        f"{name} ({type_name})"
        for name, type_name in ports
        if type_name in types and not raw_fields(type_name, types)
    ]
    if others:
        return (
            f"raw carries types of numbers alone, not {', '.join(others)}; leave it out, or use "
            "json or msgpack"
        )
    return "" if outputs else "raw needs an output: it is the program's answer"
