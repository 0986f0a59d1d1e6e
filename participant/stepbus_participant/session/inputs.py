"""The inputs of a participant: which message is due at a step, and which one is held."""

from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any

from stepbus_schemas import (
    SHIPPED,
    UNDECODABLE,
    Decoder,
    InputConfig,
    Message,
    RunError,
    Types,
    WiringError,
    due_step,
    encode,
    message_class,
    type_name,
)


class PeerFault(RunError):
    """Another participant broke the protocol; `blames` names it."""

    def __init__(self, blames: str, message: str) -> None:
        super().__init__(message)
        self.blames = blames


class Input:
    """One input port: it holds its newest due message until the next one is due (P6.3).

    value: that message; None while the input is absent. content: its bytes. fresh: whether it is
    new at this step. pending: what the source published, (step, bytes), until it is due (P6.2).
    """

    def __init__(self, name: str, config: InputConfig, types: Types = SHIPPED) -> None:
        self.name = name
        self.config = config
        self.value: Message | None = None
        self.fresh = False
        self.content: Any = None
        self.pending: deque[tuple[int, Any]] = deque()
        self._delay = config.delay
        self._every = config.every
        self._cls = message_class(config.type, types)
        self._decoder = Decoder(self._cls)
        self._decode = self._decoder.plain

    def due(self, step: int) -> int:
        """Return the step whose message is due at `step`; negative: none."""
        return due_step(step, self._delay, self._every)

    def read_as(self, cls: type[Message]) -> Message | None:
        """Return the message as a class of the input's type, and take all further ones as that.

        Such as `SensedJoints`, which requires more fields. Raises MessageError where one is
        missing, WiringError for another type.
        """
        if isinstance(self.value, cls | None):
            return self.value
        if type_name(cls) != self.config.type or not issubclass(cls, self._cls):
            raise WiringError(
                f"input {self.name!r} takes {cls.__name__}, the scenario connects "
                f"{self.config.type}"
            )
        self._decoder = Decoder(cls, f"{self.config.type} as {cls.__name__} requires it")
        self._decode = self._decoder.plain
        self.value = self._decoder(encode(self.value))
        return self.value

    def restore(self, held: bytes | None, pending: Iterable[tuple[int, bytes]]) -> None:
        """Hold a message, as saved at a checkpoint; raises MessageError for one of another type."""
        self.content = held
        self.value = None if held is None else self._decoder(held)
        # The same queue: the source fills it.
        self.pending.clear()
        self.pending.extend(pending)

    def settle(self, step: int) -> None:
        """Take the newest message that is due at a step.

        Raises PeerFault when it is not of the port's type (P8.2).
        """
        self.fresh = False
        pending = self.pending
        if not pending:
            return
        due = due_step(step, self._delay, self._every)
        while pending and pending[0][0] <= due:
            source_step, data = pending.popleft()
            self.fresh = True
            self.content = data
            try:
                self.value = self._decode(data)
            except UNDECODABLE as exc:
                where = f"{self.config.source}.{self.config.port} (input {self.name})"
                error = self._decoder.error(exc)
                raise PeerFault(
                    self.config.source, f"step {source_step}: {where}: {error}"
                ) from error


def make_inputs(configs: Mapping[str, InputConfig], types: Types = SHIPPED) -> dict[str, Input]:
    """Return the inputs of a participant by name. types: with those that do not ship.

    Raises WiringError for an unknown message type.
    """
    return {name: Input(name, config, types) for name, config in configs.items()}
