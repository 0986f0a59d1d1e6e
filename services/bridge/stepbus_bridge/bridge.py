"""What every bridged participant does, in any format."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec

from stepbus_bridge.framing import Framing, Link
from stepbus_bridge.program import Program
from stepbus_participant import Config, Participant
from stepbus_schemas import (
    SHIPPED,
    Description,
    RunError,
    Types,
    WiringError,
    explained,
    json_schema,
    not_null,
)


@dataclass(frozen=True, kw_only=True)
class BridgedProgram:
    """A program to bridge: its argv, its format, and what describes its outputs."""

    argv: Sequence[str]
    format: str
    describe: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


class Bridge(Participant):
    """Owns the program and describes its outputs.

    Raises WiringError when there is no such program, or when it is described wrongly.
    """

    def __init__(self, config: Config, bridged: BridgedProgram, framing: Framing) -> None:
        super().__init__(config)
        self._described = _descriptions(config, bridged.describe)
        self.link = Link(Program(bridged.argv, bridged.format), framing)

    def close(self) -> None:
        """Wait for the program's end; raises RunError when its exit code is not 0."""
        program = self.link.program
        program.stop()
        if program.exit_code and not self.link.failed:
            raise RunError(f"{program} {program.how_it_ended()} after the stop")


def _descriptions(config: Config, given: Mapping[str, Mapping[str, Any]]) -> dict[str, Description]:
    """Return the descriptions that are known before the program describes its outputs.

    An output with joints that nobody describes is like the first input with joints.
    """
    types = config.types
    first = next(
        (name for name, port in config.inputs.items() if has_joints(port.type, types)), None
    )
    descriptions = {
        name: Description(like=first)
        for name, port in config.outputs.items()
        if first is not None and has_joints(port.type, types)
    }
    for name, row in given.items():
        try:
            descriptions[name] = msgspec.convert(row, Description)
        except msgspec.ValidationError as exc:
            where = f"participants.{config.name}.bridge.describe.{name}"
            raise WiringError(f"{where}: {explained(exc, Description)}") from exc
    return descriptions


def has_joints(type_name: str, types: Types = SHIPPED) -> bool:
    """Return whether a message type has a vector with one entry per name."""
    fields = json_schema(type_name, types)["properties"].values()
    return any(field.get("shape", not_null(field).get("shape")) == ["n"] for field in fields)
