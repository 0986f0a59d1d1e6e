"""What the bridge speaks, and the command that starts it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Literal, get_args

Format = Literal["json", "msgpack", "raw"]

FORMATS: tuple[str, ...] = get_args(Format)

RAW_TYPES = ("JointCommand/1", "JointReference/1", "JointState/1")
"""The message types that have a layout in numbers alone."""


def bridge_words(
    form: str, describe: Mapping[str, Mapping[str, Any]], words: Sequence[str]
) -> tuple[str, ...]:
    """Return the `exec` that bridges a program. words: its own command, as in `exec`."""
    said = ("--describe", json.dumps(describe)) if describe else ()
    return ("stepbus", "bridge", "--format", form, *said, "--", *words)


def raw_mistake(publishes: str, inputs: Mapping[str, str], outputs: Mapping[str, str]) -> str:
    """Return why a participant cannot be bridged raw, or nothing. inputs, outputs: port → type."""
    if publishes == "first":
        return "raw cannot publish first; take json or msgpack"
    ports = [*inputs.items(), *outputs.items()]
    others = [f"{name} ({kind})" for name, kind in ports if kind not in RAW_TYPES]
    if others:
        return (
            f"raw carries {', '.join(RAW_TYPES)}, not {', '.join(others)}; leave it out, or take "
            "json or msgpack"
        )
    return "" if outputs else "raw needs an output: it is the program's answer"
