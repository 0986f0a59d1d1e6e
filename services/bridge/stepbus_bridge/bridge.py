"""The base class of the bridge: a participant whose outputs another program computes."""

from collections.abc import Mapping, Sequence

from stepbus_bridge.program import Framing, Program
from stepbus_participant import Config, Participant
from stepbus_schemas import Description, Types, json_schema, not_null

Described = Mapping[str, Description]
"""Output → its description, as the scenario gives it."""


class Bridge(Participant):
    """Owns the program and describes its outputs.

    Raises WiringError if the program does not exist.
    """

    def __init__(
        self, config: Config, argv: Sequence[str], form: str, describe: Described, framing: Framing
    ) -> None:
        super().__init__(config)
        self._described = _descriptions(config, describe)
        self.program = Program(argv, form, framing)

    def close(self) -> None:
        """Tell the program that the run is over."""
        self.program.stop()

    def await_end(self) -> str:
        """Wait for the program's end; return an error message about its exit code, or ''."""
        # The orchestrator kills it, and us, if that lasts.
        self.program.has_ended(wait=True)
        if not self.program.exit_code or self.program.failed:
            return ""
        return f"{self.config.name}: {self.program} {self.program.how_it_ended()} after the stop"


def _descriptions(config: Config, given: Described) -> dict[str, Description]:
    """Return the descriptions that are known before the program describes its outputs.

    An output with joints that is not described is like the first input with joints.
    """
    types = config.types
    inputs = (name for name, port in config.inputs.items() if _has_joints(port.type, types))
    first = next(inputs, None)
    like_first = {
        name: Description(like=first)
        for name, port in config.outputs.items()
        if first is not None and _has_joints(port.type, types)
    }
    return {**like_first, **given}


def _has_joints(type_name: str, types: Types) -> bool:
    """Return whether a message type has a vector with one entry per name."""
    fields = json_schema(type_name, types)["properties"].values()
    return any(field.get("shape", not_null(field).get("shape")) == ["n"] for field in fields)
