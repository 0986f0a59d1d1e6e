"""Outputs come in any order, and are written by step, then participant, then port (P13.1)."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence

import msgspec

from stepbus_orchestrator.errors import ParticipantFault
from stepbus_schemas import Outputs


class Published(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """What one participant published at one step: (port, bytes) in the order of the scenario.

    fault: of the port behind the last one, whose bulk content has another length than announced.
    """

    participant: str
    step: int
    content: list[tuple[str, bytes]]
    fault: ParticipantFault | None = None


class _Buffer:
    """The outputs of one participant that wait for their turn."""

    def __init__(self, name: str, ports: Sequence[str]) -> None:
        self.name = name
        self.ports = ports
        self.waiting: deque[Outputs] = deque()
        self.bulk: dict[tuple[int, str], bytes] = {}

    def has_bulk(self, outputs: Outputs) -> bool:
        return all((outputs.step, port) in self.bulk for port in outputs.bulk)

    def take(self) -> Published:
        """Return the next outputs, with their bulk content."""
        outputs = self.waiting.popleft()
        step, plain, content = outputs.step, outputs.ports, []
        for port in self.ports:
            if port in plain:
                content.append((port, bytes(plain[port])))
            elif self.bulk and (step, port) in self.bulk:
                data, announced = self.bulk.pop((step, port)), outputs.bulk.get(port)
                if len(data) != announced:
                    fault = ParticipantFault(
                        f"step {step}: {self.name} announced {announced} bytes on bulk port "
                        f"{port!r} and sent {len(data)}",
                        participant=self.name,
                        step=step,
                    )
                    return Published(participant=self.name, step=step, content=content, fault=fault)
                content.append((port, data))
        return Published(participant=self.name, step=step, content=content)


class StepOrder:
    """Keeps outputs until their step is complete, and returns them in order.

    ports: participant, in schedule order → its ports, in scenario order.
    """

    def __init__(self, ports: Mapping[str, Sequence[str]]) -> None:
        self._buffers = {name: _Buffer(name, list(own)) for name, own in ports.items()}
        self._next = 0

    def offer(self, name: str, outputs: Outputs) -> None:
        """Keep the outputs of one participant, which come in the order of their steps."""
        self._buffers[name].waiting.append(outputs)

    def offer_bulk(self, name: str, port: str, step: int, content: bytes) -> None:
        """Keep the content of a bulk port, before or after the outputs that announce it."""
        self._buffers[name].bulk[(step, port)] = content

    def bulk_complete(self) -> bool:
        """Return whether all announced bulk content has arrived."""
        return all(b.has_bulk(outputs) for b in self._buffers.values() for outputs in b.waiting)

    def complete_below(self, end: int) -> Iterator[int]:
        """Yield the next steps below `end`, up to the first that lacks bulk content."""
        buffers = list(self._buffers.values())
        while self._next < end:
            for buffer in buffers:
                head = buffer.waiting[0] if buffer.waiting else None
                if head and head.bulk and head.step == self._next and not buffer.has_bulk(head):
                    return
            yield self._next
            self._next += 1

    def take(self, step: int) -> Iterator[Published]:
        """Yield the outputs of one step, participant by participant."""
        for buffer in self._buffers.values():
            while buffer.waiting and buffer.waiting[0].step == step:
                yield buffer.take()

    def drop_behind(self, closing_step: int, closing: Sequence[str]) -> None:
        """Drop what does not belong to the run: all behind its closing step.

        closing: those who publish at the closing step; of all others nothing is left to write.
        """
        for name, buffer in self._buffers.items():
            is_kept = name in closing
            rest = (outputs for outputs in buffer.waiting if is_kept)
            buffer.waiting = deque(o for o in rest if o.step <= closing_step)

    def steps(self) -> list[int]:
        """Return the steps that wait, in order."""
        return sorted({o.step for buffer in self._buffers.values() for o in buffer.waiting})
