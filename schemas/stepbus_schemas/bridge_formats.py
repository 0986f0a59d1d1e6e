"""The formats that the bridge speaks to a program (docs/guide/bridge.md)."""

from collections.abc import Mapping
from typing import Literal, get_args

BridgeFormat = Literal["json", "msgpack", "raw"]

BRIDGE_FORMATS: tuple[str, ...] = get_args(BridgeFormat)

RAW_TYPES = ("JointCommand/1", "JointReference/1", "JointState/1")
"""The message types that have a layout in numbers alone."""


def raw_problem(publishes: str, inputs: Mapping[str, str], outputs: Mapping[str, str]) -> str:
    """Return why format `raw` cannot carry a participant; empty where it can.

    inputs, outputs: port → message type.
    """
    if publishes == "first":
        return "raw cannot publish first; use json or msgpack"
    ports = [*inputs.items(), *outputs.items()]
    others = [f"{name} ({type_name})" for name, type_name in ports if type_name not in RAW_TYPES]
    if others:
        return (
            f"raw carries {', '.join(RAW_TYPES)}, not {', '.join(others)}; leave it out, or use "
            "json or msgpack"
        )
    return "" if outputs else "raw needs an output: it is the program's answer"
