"""Saves the state of a participant between two steps, and starts from a saved one (P16)."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from stepbus_participant.bus import Bus
from stepbus_participant.bus.ticket import CheckpointOrder
from stepbus_participant.inputs import Input, Source
from stepbus_participant.participant import Participant
from stepbus_schemas import UNDECODABLE, RunError, Welcome, encode, error_text, explained

from .outbox import stamp

ENCODING = "application/octet-stream"


class _HeldInput(msgspec.Struct):
    """held: its newest message. pending: those that are ahead of their due step, with step."""

    held: bytes | None
    pending: list[tuple[int, bytes]]


class _Saved(msgspec.Struct):
    """inputs: by name. sources: name → newest step taken. own: what the participant saved."""

    inputs: dict[str, _HeldInput]
    sources: dict[str, int]
    own: bytes


_decode = msgspec.msgpack.Decoder(_Saved).decode


class Checkpoints:
    """The checkpoints of one participant: its own state, and what its inputs hold.

    A participant takes from a source only what is due (P6.2); so all of it is a function of the
    step.
    """

    def __init__(
        self,
        participant: Participant,
        welcome: Welcome,
        bus: Bus,
        *,
        order: CheckpointOrder,
        inputs: Mapping[str, Input],
        sources: Sequence[Source],
    ) -> None:
        self._participant = participant
        self._order = order
        self._welcome = welcome
        self._inputs = inputs
        self._sources = {source.name: source for source in sources}
        if order.every:
            self._put = bus.publisher(f"checkpoint/{welcome.name}", ENCODING)
        self._is_too_large = False

    def save_if_due(self, step: int) -> None:
        """Publish the state before a step, where one is due (P16.1)."""
        period = self._order.every
        if step > 0 and step // period > (step - self._welcome.every) // period:
            own = self._participant.save()
            if own is not None:
                self._publish(step, msgspec.msgpack.encode(self._saved(own)))

    def _saved(self, own: bytes) -> _Saved:
        return _Saved(
            inputs={
                name: _HeldInput(
                    held=None if item.value is None else encode(item.value),
                    pending=[(step, bytes(data)) for step, data in item.pending],
                )
                for name, item in self._inputs.items()
            },
            sources={name: source.step for name, source in self._sources.items()},
            own=own,
        )

    def _publish(self, step: int, state: bytes) -> None:
        limit = self._welcome.max_outputs_bytes
        if len(state) <= limit:
            self._put(state, attachment=stamp(step, self._welcome.token))
        elif not self._is_too_large:
            self._is_too_large = True
            sys.stderr.write(
                f"warning: step {step}: no checkpoint: the state has {len(state)} bytes, the limit "
                f"of the bus is {limit}\n"
            )

    def restore(self) -> int:
        """Take the state of the order, if it has one, and return the first step to do (P16.3).

        Raises RunError for a state that does not fit.
        """
        if not self._order.state:
            return 0
        where = f"the checkpoint of {self._welcome.name} before step {self._order.step}"
        try:
            saved = _decode(Path(self._order.state).read_bytes())
        except (OSError, *UNDECODABLE) as exc:
            raise RunError(f"cannot read {where}: {explained(exc)}") from exc
        if saved.inputs.keys() != self._inputs.keys() or saved.sources.keys() != set(self._sources):
            raise RunError(f"{where} belongs to a participant with different inputs")
        for name, item in saved.inputs.items():
            self._inputs[name].restore(item.held, item.pending)
        for name, step in saved.sources.items():
            self._sources[name].continue_after(step)
        try:
            self._participant.restore(saved.own)
        except Exception as exc:
            why = explained(exc) if isinstance(exc, UNDECODABLE) else error_text(exc)
            raise RunError(
                f"{where} cannot be restored: {why}; branch without checkpoints"
            ) from exc
        return self._order.step
