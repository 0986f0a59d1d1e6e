"""The newest message of each output, decoded when somebody asks for it."""

from collections.abc import Callable

from stepbus_participant import suggest
from stepbus_schemas import Decoder, Message, WiringError, message_class

from .state import RunState


class Newest:
    """Decodes the newest messages of a run."""

    def __init__(self, state: RunState) -> None:
        self._state = state
        self._decoders: dict[str, Callable[[bytes], Message]] = {}

    def message(self, output: str) -> Message | None:
        """Return the newest message of an output, such as `plant.joint_state`; None before one.

        Raises WiringError for an output that the scenario does not have, or whose messages are
        bulk, MessageError for a message that is not of its type.
        """
        name, _, port = output.partition(".")
        if output not in self._decoders:
            self._decoders[output] = self._decoder(output)
        raw = self._state.newest.get(name, {}).get(port)
        return None if raw is None else self._decoders[output](bytes(raw))

    def _decoder(self, output: str) -> Callable[[bytes], Message]:
        types = {
            f"{spec.name}.{port}": described.type
            for spec in self._state.scenario.participants
            for port, described in spec.outputs.items()
            if not described.bulk
        }
        if output not in types:
            raise WiringError(f"no output {output!r}{suggest(output, types)}")
        return Decoder(message_class(types[output], self._state.scenario.types))
