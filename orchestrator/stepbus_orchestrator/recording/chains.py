"""Hash chains: they sum up what each participant has published, and prove that nothing is missing.

P13.2 and P13.3 of docs/protocol.md.
"""

import contextlib
import hashlib
from collections.abc import Iterable, Mapping
from typing import Any

from stepbus_orchestrator.recording import layout
from stepbus_schemas import CHAIN_EVERY, Chain, Decoder, MessageError

_decode_chain = Decoder(Chain)


class HashChain:
    """Sums up all outputs of a participant so far in one SHA-256.

    Two recordings with equal values have equal outputs up to there. value: 32 bytes, zero at first.
    """

    def __init__(self) -> None:
        self.value = bytes(32)

    def extend(self, step: int, published: Iterable[tuple[str, bytes]]) -> None:
        """Add one step. published: (port, recorded bytes), in the order of the scenario."""
        parts = [self.value, step_key(step)]
        for port, data in published:
            parts += (port.encode(), data)
        self.value = summed(parts)


def step_key(step: int) -> bytes:
    """Return a step as it is hashed: int64, little-endian."""
    return step.to_bytes(8, "little", signed=True)


def summed(parts: Iterable[bytes]) -> bytes:
    """Return the SHA-256 of bytes: the value of a chain before, a step, and ports with messages."""
    # One call of the hash for all parts: of few bytes, each takes longer than the hashing.
    return hashlib.sha256(b"".join(parts)).digest()


def messages_sha256(last_chain: bytes) -> str:
    """Return the SHA-256 of all messages of a recording in hexadecimal (P13.3).

    last_chain: the last message of `stepbus/chain`. Files, versions and the processor, which are in
    the recording too, do not change it.
    """
    return hashlib.sha256(last_chain).hexdigest()


class Holes:
    """Finds what a recording lacks, from its messages in recorded order: its hash chains break.

    scenario: the content of its `scenario.yaml`; without participants nothing can be missed.
    """

    def __init__(self, scenario: Mapping[str, Any]) -> None:
        self._links = {name: _Link(every) for name, every in _every(scenario).items()}
        self._last_chain = -1
        self.found: list[str] = []
        """One sentence for each hole so far."""

    def add(self, topic: str, step: int, data: bytes) -> None:
        """Add one message."""
        if topic == layout.CHAIN_TOPIC:
            self._check(step, data)
            return
        name, port = layout.split_topic(topic)
        if name in self._links and topic != layout.CALLS_TOPIC:
            self._links[name].steps.setdefault(step, []).append((port, data))

    def _check(self, step: int, data: bytes) -> None:
        if step > self._last_chain + CHAIN_EVERY:
            gap = f"between steps {self._last_chain} and {step}"
            self.found.append(f"{layout.CHAIN_TOPIC}: nothing {gap}")
        self._last_chain = step
        try:
            hashes = _decode_chain(data).hashes
        except MessageError as exc:
            self.found.append(f"{layout.CHAIN_TOPIC}: step {step} is {exc}")
            return
        for name, expected in hashes.items():
            if name in self._links and not self._links[name].reaches(step, expected):
                self.found.append(f"{name}: the hash chain breaks at or before step {step}")


class _Link:
    """The hash chain of one participant from its last recorded value on.

    steps: what it has published since that value.
    """

    def __init__(self, every: int) -> None:
        self.steps: dict[int, list[tuple[str, bytes]]] = {}
        self._every = every
        self._chain = HashChain()
        self._next = 0

    def reaches(self, last: int, expected: str) -> bool:
        """Return whether the chain gets to a recorded value; go on from that, so or so.

        In a run that failed it ends before `last`.
        """
        while not (is_equal := self._is_at(expected)) and self._next <= last:
            self._chain.extend(self._next, self.steps.pop(self._next, ()))
            self._next += self._every
        with contextlib.suppress(ValueError):
            self._chain.value = bytes.fromhex(expected)
        self._next = max(self._next, last // self._every * self._every + self._every)
        self.steps.clear()
        return is_equal

    def _is_at(self, expected: str) -> bool:
        return not self.steps and self._chain.value.hex() == expected


def _every(scenario: Mapping[str, Any]) -> dict[str, int]:
    """Return participant → `every`, as far as a resolved scenario says it."""
    with contextlib.suppress(KeyError, TypeError, AttributeError, ValueError):
        rows = scenario["participants"].items()
        return {name: max(1, int(row.get("every", 1))) for name, row in rows}
    return {}
