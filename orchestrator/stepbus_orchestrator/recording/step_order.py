"""The hash chain of one participant (P13.2), and the hash of all messages (P13.3)."""

import hashlib
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence

import msgspec

from stepbus_orchestrator.errors import ParticipantFault
from stepbus_schemas import Outputs


class HashChain:
    """Sums up all outputs of a participant so far in one SHA-256.

    Two recordings with equal values have equal outputs up to there. value: 32 bytes, zero at first.
    """

    def __init__(self) -> None:
        self.value = bytes(32)

    def extend(self, step: int, published: Iterable[tuple[str, bytes]]) -> None:
        """Take in one step. published: (port, recorded bytes), in the order of the scenario."""
        parts = [self.value, step.to_bytes(8, "little", signed=True)]
        for port, data in published:
            parts += (port.encode(), data)
        # One call of the hash for all parts: of few bytes, each takes longer than the hashing.
        self.value = hashlib.sha256(b"".join(parts)).digest()


def messages_sha256(last_chain: bytes) -> str:
    """Return the SHA-256 of all messages of a recording in hexadecimal (P13.3).

    last_chain: the last message of `stepbus/chain`. Files, versions and the processor, which are in
    the recording too, do not change it.
    """
    return hashlib.sha256(last_chain).hexdigest()


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

    def lacks_bulk(self, step: int) -> bool:
        """Return whether bulk content of its next outputs is missing, and they are of a step."""
        head = self.waiting[0] if self.waiting else None
        if head is None or not head.bulk:
            return False
        return head.step == step and not self.has_bulk(head)

    def take(self) -> Published:
        outputs = self.waiting.popleft()
        if not self.bulk:
            ports = outputs.ports
            content = [(port, bytes(ports[port])) for port in self.ports if port in ports]
            return Published(participant=self.name, step=outputs.step, content=content)
        published = Published(participant=self.name, step=outputs.step, content=[])
        for port in self.ports:
            try:
                data = self._content(outputs, port)
            except ParticipantFault as exc:
                return msgspec.structs.replace(published, fault=exc)
            if data is not None:
                published.content.append((port, data))
        return published

    def _content(self, outputs: Outputs, port: str) -> bytes | None:
        raw = outputs.ports.get(port)
        if raw is not None:
            return bytes(raw)
        return self._bulk_content(outputs, port)

    def _bulk_content(self, outputs: Outputs, port: str) -> bytes | None:
        content = self.bulk.pop((outputs.step, port), None)
        announced = outputs.bulk.get(port)
        if content is not None and len(content) != announced:
            raise ParticipantFault(
                f"step {outputs.step}: {self.name} announced {announced} bytes on bulk port "
                f"{port!r} and sent {len(content)}",
                participant=self.name,
                step=outputs.step,
            )
        return content


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
                waiting = buffer.waiting
                if waiting and waiting[0].bulk and buffer.lacks_bulk(self._next):
                    return
            yield self._next
            self._next += 1

    def take(self, step: int) -> Iterator[Published]:
        """Yield the outputs of one step, participant by participant."""
        for buffer in self._buffers.values():
            while buffer.waiting and buffer.waiting[0].step == step:
                yield buffer.take()

    def end(self, closing_step: int, closing: Sequence[str]) -> None:
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
