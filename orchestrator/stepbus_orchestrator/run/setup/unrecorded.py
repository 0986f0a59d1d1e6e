"""What stands in for the recording of a run that nobody records."""

from collections.abc import Callable, Collection, Mapping, Sequence

from stepbus_orchestrator.errors import ParticipantFault
from stepbus_orchestrator.recording import Descriptions, TimingRecorder
from stepbus_orchestrator.scenario import ParticipantSpec
from stepbus_schemas import CallRecord, Decoder, Event, MessageError, Outputs, type_name

_EVENT = type_name(Event)


class NoRecorder:
    """A sink that keeps nothing; events are reported all the same.

    order: the participants. on_event: gets every Event.
    """

    messages_sha256 = ""
    silent: Collection[tuple[str, str]] = frozenset()

    def __init__(
        self,
        order: Sequence[ParticipantSpec],
        on_event: Callable[[str, str, int, Event], None],
    ) -> None:
        self._on_event = on_event
        self._ports = {
            spec.name: [port for port, row in spec.outputs.items() if row.type == _EVENT]
            for spec in order
        }
        self._decode = Decoder(Event)

    def open_channels(
        self, descriptions: Descriptions, versions: Mapping[str, Mapping[str, str]]
    ) -> None:
        """Do nothing."""

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Do nothing."""

    def add_call(self, call: CallRecord) -> None:
        """Do nothing."""

    def offer(self, name: str, outputs: Outputs) -> None:
        """Report the events among the outputs of one participant."""
        for port in self._ports[name]:
            if port in outputs.ports:
                self._on_event(name, port, outputs.step, self._event(name, port, outputs))

    def _event(self, name: str, port: str, outputs: Outputs) -> Event:
        try:
            return self._decode(outputs.ports[port])
        except MessageError as exc:
            text = f"step {outputs.step}: {name}.{port} is {exc}"
            raise ParticipantFault(text, participant=name, step=outputs.step) from exc

    def offer_bulk(self, name: str, port: str, step: int, content: bytes) -> None:
        """Do nothing."""

    def bulk_complete(self) -> bool:
        """Return True: nobody waits for it."""
        return True

    def write_below(self, step: int) -> None:
        """Do nothing."""

    def flush(self) -> None:
        """Do nothing."""

    def finish(self, closing_step: int, closing: Sequence[str]) -> None:
        """Do nothing."""

    def abort(self) -> None:
        """Do nothing."""


class NoTiming(TimingRecorder):
    """Records no times."""

    def __init__(self) -> None:
        """Open no file."""

    def event(self, event: str, participant: str = "", text: str = "") -> None:
        """Do nothing."""

    def steps(self, participant: str, rows: list[tuple[int, int, int]]) -> None:
        """Do nothing."""

    def trigger(self, step_limit: int) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""
