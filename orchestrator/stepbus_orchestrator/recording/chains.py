"""Hash chains: they sum up what each participant has published, and prove that nothing is missing.

P13.2 and P13.3 of docs/protocol.md.
"""

import contextlib
import hashlib
import re
from collections.abc import Collection, Iterable, Mapping
from functools import partial
from typing import Any

from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.chunk import BIG_BYTES
from stepbus_orchestrator.recording.workers import Workers
from stepbus_schemas import CHAIN_EVERY, Chain, Decoder, MessageError

_decode_chain = Decoder(Chain)
_ROWS = "participants"
_RARELY = re.compile("every ([0-9]+)")
_REGULAR = 20
"""Behind the last chain, a port that spoke so often without a pause was not silent: it lacks it."""


class HashChain:
    """Sums up all outputs of a participant so far in one SHA-256.

    Two recordings with equal values have equal outputs up to there. value: 32 bytes, zero at first.
    """

    def __init__(self) -> None:
        self.value = bytes(32)

    def extend(self, step: int, published: Collection[tuple[str, bytes]]) -> None:
        """Add one step. published: (port, recorded bytes), in the order of the scenario."""
        parts = [self.value, step.to_bytes(8, "little", signed=True)]
        for port, data in published:
            parts += (port.encode(), data)
        # One call of the hash for all parts: of few bytes, each takes longer than the hashing.
        self.value = hashlib.sha256(b"".join(parts)).digest()

    def close(self) -> None:
        """Add nothing more."""


class ThreadedChain(HashChain):
    """The chain of a participant with bulk ports: big messages are hashed in a thread."""

    def __init__(self) -> None:
        self._workers: Workers[None] = Workers(lambda _none: None, threads=1)
        super().__init__()

    @property
    def value(self) -> bytes:
        """Return it, once all steps that were added are in it."""
        self._workers.drain()
        return self._value

    @value.setter
    def value(self, value: bytes) -> None:
        self._value = value

    def extend(self, step: int, published: Collection[tuple[str, bytes]]) -> None:
        """Add one step."""
        if self._workers.are_busy or any(len(data) > BIG_BYTES for _, data in published):
            size = sum(len(data) for _, data in published)
            self._workers.give(partial(self._extend, step, published), size)
        else:
            super().extend(step, published)

    def close(self) -> None:
        """End the thread."""
        self._workers.close()

    def _extend(self, step: int, published: Iterable[tuple[str, bytes]]) -> None:
        """Add one step without copying it, in the thread."""
        digest = hashlib.sha256(self._value + step.to_bytes(8, "little", signed=True))
        for port, data in published:
            digest.update(port.encode())
            digest.update(data)
        self._value = digest.digest()


def messages_sha256(last_chain: bytes) -> str:
    """Return the SHA-256 of all messages of a recording in hexadecimal (P13.3).

    last_chain: the last message of `stepbus/chain`. Files, versions and the processor, which are in
    the recording too, do not change it.
    """
    return hashlib.sha256(last_chain).hexdigest()


class Holes:
    """Finds what a recording lacks, from its messages in recorded order.

    scenario: the content of its `scenario.yaml`; without participants nothing can be missed.
    """

    def __init__(self, scenario: Mapping[str, Any]) -> None:
        self._participants = {row[0]: _Participant(*row) for row in _every(scenario)}
        self._last_chain = -1
        self._gaps: list[str] = []

    def add(self, topic: str, step: int, data: bytes) -> None:
        """Add one message."""
        if topic == layout.CHAIN_TOPIC:
            self._check(step, data)
            return
        name, port = layout.split_topic(topic)
        participant = self._participants.get(name)
        if participant is not None and topic != layout.CALLS_TOPIC:
            participant.add(port, step, data)

    def end(self) -> list[str]:
        """Return a sentence for each hole, once every message has been added."""
        for participant in self._participants.values():
            self._gaps += participant.silences(_REGULAR)
        return self._gaps

    def _check(self, step: int, data: bytes) -> None:
        if step > self._last_chain + CHAIN_EVERY:
            gap = f"between steps {self._last_chain} and {step}"
            self._gaps.append(f"{layout.CHAIN_TOPIC}: nothing {gap}")
        self._last_chain = step
        try:
            hashes = _decode_chain(data).hashes
        except MessageError as exc:
            self._gaps.append(f"{layout.CHAIN_TOPIC}: step {step} is {exc}")
            return
        for name, expected in hashes.items():
            participant = self._participants.get(name)
            if participant is None:
                continue
            if not participant.reaches(step, expected):
                self._gaps += participant.silences(0)
                self._gaps.append(f"{name}: the hash chain breaks at or before step {step}")
            participant.go_on(step, expected)


class _Participant:
    """One participant: its hash chain, and what it published since that was last confirmed."""

    def __init__(self, name: str, every: int, ports: Mapping[str, int]) -> None:
        self._name = name
        self._every = every
        self._every_of = ports
        self._chain = HashChain()
        self._next = 0
        self._steps: dict[int, list[tuple[str, bytes]]] = {}
        self._ports: dict[str, tuple[int, int]] = {}
        self._gaps: list[tuple[str, int, int, int]] = []

    def add(self, port: str, step: int, data: bytes) -> None:
        self._steps.setdefault(step, []).append((port, data))
        every = self._every_of.get(port, self._every)
        last, count = self._ports.get(port, (step - every, 0))
        if step != last + every:
            self._gaps.append((port, last, step, count))
            count = 0
        self._ports[port] = (step, count + 1)

    def reaches(self, last: int, expected: str) -> bool:
        """Extend the chain up to a recorded value; in a run that failed it ends before `last`."""
        while not self._stands_at(expected) and self._next <= last:
            self._chain.extend(self._next, self._steps.pop(self._next, ()))
            self._next += self._every
        return self._stands_at(expected)

    def _stands_at(self, expected: str) -> bool:
        return not self._steps and self._chain.value.hex() == expected

    def go_on(self, step: int, expected: str) -> None:
        """Continue from a recorded value, so that each hole is found once."""
        with contextlib.suppress(ValueError):
            self._chain.value = bytes.fromhex(expected)
        self._next = max(self._next, step // self._every * self._every + self._every)
        self._steps.clear()
        self._gaps.clear()

    def silences(self, regular: int) -> list[str]:
        """Return where ports did not speak that had spoken `regular` times without a pause."""
        return [
            f"{self._name}/{port}: nothing between steps {before} and {after}"
            if after > before
            else f"{self._name}/{port}: step {after} follows step {before}"
            for port, before, after, count in self._gaps
            if count >= regular or after <= before
        ]


def _every(scenario: Mapping[str, Any]) -> list[tuple[str, int, dict[str, int]]]:
    """Return each participant with its `every`, and those of ports that are recorded more rarely.

    As far as a resolved scenario says it.
    """
    with contextlib.suppress(KeyError, TypeError, AttributeError, ValueError):
        rows = {name: (row, int(row.get("every", 1))) for name, row in scenario[_ROWS].items()}
        return [(name, max(1, every), _rarer(row, every)) for name, (row, every) in rows.items()]
    return []


def _rarer(row: Mapping[str, Any], every: int) -> dict[str, int]:
    outputs = {k: v for k, v in row.get("outputs", {}).items() if isinstance(v, dict)}
    found = ((port, _RARELY.fullmatch(str(o.get("record")))) for port, o in outputs.items())
    return {port: every * int(match[1]) for port, match in found if match}
