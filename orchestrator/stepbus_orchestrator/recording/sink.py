"""Takes what a run records in whatever order it arrives, and writes it in order (P13.1).

That is by step, then participant, then port.
"""

from collections import deque
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Protocol

import msgspec

from stepbus_orchestrator.errors import ParticipantFault, RunFailure
from stepbus_schemas import CallRecord, Description, Outputs

Descriptions = Mapping[str, Mapping[str, Description]]
"""Participant → output → its description."""


class Published(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """What one participant published at one step: (port, bytes) in the order of the scenario.

    fault: of the port after the last one, whose bulk content has another length than announced.
    """

    participant: str
    step: int
    content: list[tuple[str, bytes]]
    fault: ParticipantFault | None = None


class Reviser(Protocol):
    """Sees all that is about to be recorded, and may put something else in its place."""

    def revise(
        self, step: int, published: Sequence[Published], closing: Collection[str] | None
    ) -> Sequence[Published]:
        """Return what is recorded of a step, in schedule order.

        closing: at the closing step, those that publish at it. A RunFailure that it raises ends the
        recording before the step.
        """

    def revise_call(self, call: CallRecord) -> CallRecord:
        """Return what is recorded of a call."""


class Sink:
    """Puts the outputs of a run in order, and checks bulk content; a `Recorder` writes them too.

    ports: participant, in schedule order → its ports, in scenario order. partly: participant → port
    that is not recorded whole → every how many steps it is; 0: never. What is left out is neither
    checked nor waited for. reviser: sees each step before it is written.

    Methods that write raise ParticipantFault for bulk content of another length than announced.
    """

    def __init__(
        self,
        ports: Mapping[str, Iterable[str]],
        partly: Mapping[str, Mapping[str, int]] = MappingProxyType({}),
    ) -> None:
        self.reviser: Reviser | None = None
        self._partly = partly
        self._ports_of = {name: list(own) for name, own in ports.items()}
        self._waiting: dict[str, deque[Outputs]] = {name: deque() for name in ports}
        self._bulk: dict[tuple[str, int, str], bytes] = {}
        self._broken: set[str] = set()
        self._announces_bulk = False
        self._next = 0

    # --- what arrives ---------------------------------------------------------------------

    def offer(self, name: str, outputs: Outputs) -> None:
        """Keep the outputs of one participant, which come in the order of their steps."""
        self._waiting[name].append(outputs)
        if outputs.bulk:
            self._announces_bulk = True

    def offer_all(self, name: str, batch: Iterable[Outputs]) -> None:
        """Keep several outputs of one participant."""
        self._waiting[name].extend(batch)

    def offer_bulk(self, name: str, port: str, step: int, content: bytes) -> None:
        """Keep the content of a bulk port, before or after the outputs that announce it."""
        if self.is_recorded(name, port, step):
            self._bulk[name, step, port] = content

    def is_recorded(self, name: str, port: str, step: int) -> bool:
        """Return whether the recording gets what a port publishes at a step."""
        every = self._partly[name].get(port, 1) if name in self._partly else 1
        return bool(every) and step % every == 0

    def owing_bulk(self) -> dict[str, int]:
        """Return whose announced bulk content has not arrived → the first step of it."""
        return {
            name: outputs.step
            for name, own in self._waiting.items()
            for outputs in reversed(own)
            if not self._has_bulk(name, outputs)
        }

    def _has_bulk(self, name: str, outputs: Outputs) -> bool:
        step, bulk = outputs.step, self._bulk
        return all(
            (name, step, port) in bulk or not self.is_recorded(name, port, step)
            for port in outputs.bulk
        )

    # --- in order -------------------------------------------------------------------------

    def _take(self, step: int) -> Iterator[Published]:
        for name, own in self._waiting.items():
            while own and own[0].step == step:
                yield self._published(name, own.popleft())

    def _published(self, name: str, outputs: Outputs) -> Published:
        step, plain, bulk, content = outputs.step, outputs.ports, self._bulk, []
        ports = self._ports_of[name]
        if self._partly and name in self._partly:
            ports = [port for port in ports if self.is_recorded(name, port, step)]
        for port in ports:
            if port in plain:
                content.append((port, bytes(plain[port])))
            elif bulk and (name, step, port) in bulk:
                data, announced = bulk.pop((name, step, port)), outputs.bulk.get(port)
                if len(data) != announced:
                    fault = ParticipantFault(
                        f"step {step}: {name} announced {announced} bytes on bulk port "
                        f"{port!r} and sent {len(data)}",
                        participant=name,
                        step=step,
                    )
                    self.broke(name)
                    return Published(participant=name, step=step, content=content, fault=fault)
                content.append((port, data))
        return Published(participant=name, step=step, content=content)

    def drop_behind(self, closing_step: int, closing: Collection[str]) -> None:
        """Drop what does not belong to the run: all after its closing step.

        closing: those that publish at the closing step; of all others nothing is left to write.
        """
        for name, own in self._waiting.items():
            rest = [o for o in own if name in closing and o.step <= closing_step]
            self._waiting[name] = deque(rest)

    # --- what is written ------------------------------------------------------------------

    def write_below(self, step: int) -> None:
        """Write all steps below `step`, up to the first that lacks bulk content."""
        while self._next < step and not (self._announces_bulk and self._lacks_bulk(self._next)):
            self.write_step(self._next)
            self._next += 1

    def _lacks_bulk(self, step: int) -> bool:
        heads = [(name, own[0]) for name, own in self._waiting.items() if own]
        return any(head.step == step and not self._has_bulk(name, head) for name, head in heads)

    def finish(self, closing_step: int, closing: Collection[str]) -> None:
        """Write what is left: up to `closing_step`, and at that the outputs of those named.

        What a participant published after the closing step is no part of the run and is dropped.
        """
        self.write_below(closing_step)
        self.drop_behind(closing_step, closing)
        self.write_step(closing_step, closing)

    def abort(self) -> None:
        """Write whatever has arrived; harmless when repeated."""

    def broke(self, name: str) -> None:
        """Record no more of a participant: it has published something that cannot be recorded."""
        self._broken.add(name)
        self._waiting[name].clear()

    def has_broken(self, name: str | None) -> bool:
        """Return whether a participant has published something that cannot be recorded."""
        return name in self._broken

    def write_step(self, step: int, closing: Collection[str] | None = None) -> None:
        """Write the outputs of a step; closing: at the last one, those that do."""
        for published in self.revised(step, closing):
            if published.fault is not None:
                raise published.fault

    def revised(self, step: int, closing: Collection[str] | None = None) -> Iterable[Published]:
        """Return the outputs of a step that are to be written, and forget them."""
        if self.reviser is None:
            return self._take(step)
        try:
            return self.reviser.revise(step, list(self._take(step)), closing)
        except RunFailure:
            # Nothing follows a step that is not there.
            self.drop_behind(-1, ())
            raise

    def open_channels(
        self, descriptions: Descriptions, versions: Mapping[str, Mapping[str, str]]
    ) -> None:
        """Take how the participants describe their outputs, and what they run on."""

    def add_metadata(self, name: str, content: Mapping[str, str], before: int = 0) -> None:
        """Write a fact about the run that is no message, before the messages of a step."""

    def add_call(self, call: CallRecord) -> None:
        """Write a call that changed something; all steps before its own are written (P15.5)."""
        self.write_call(call if self.reviser is None else self.reviser.revise_call(call))

    def write_call(self, call: CallRecord) -> None:
        """Write a call as it is, before the outputs of its step."""

    def flush(self) -> None:
        """Keep what is written safe from a kill; called by the wall clock, changes no result."""
