"""Finds what a recording lacks, by its hash chains and by the steps of its messages."""

import contextlib
from collections.abc import Mapping

from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.step_order import HashChain
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import CHAIN_EVERY, Chain, Decoder, MessageError, StepbusError

_decode_chain = Decoder(Chain)
_REGULAR = 20
"""Behind the last chain, a port that spoke so often without a pause was not silent: it lacks it."""


class Holes:
    """Takes the messages of a recording in recorded order.

    scenario: its `scenario.yaml`; without one nothing can be missed. found: one sentence for each
    hole.
    """

    def __init__(self, scenario: bytes | None) -> None:
        every = _every(scenario)
        self._participants = {name: _Participant(name, every[name]) for name in every}
        self._last_chain = -1
        self.gaps: list[str] = []

    def take(self, topic: str, step: int, data: bytes) -> None:
        """Take one message."""
        if topic == layout.CHAIN_TOPIC:
            self._check(step, data)
            return
        name, port = layout.split_topic(topic)
        participant = self._participants.get(name)
        if participant is not None and topic != layout.CALLS_TOPIC:
            participant.take(port, step, data)

    def end(self) -> list[str]:
        """Return all that is missing, once every message has been taken."""
        for participant in self._participants.values():
            self.gaps += participant.silences(_REGULAR)
        return self.gaps

    def _check(self, step: int, data: bytes) -> None:
        if step > self._last_chain + CHAIN_EVERY:
            gap = f"between steps {self._last_chain} and {step}"
            self.gaps.append(f"{layout.CHAIN_TOPIC}: nothing {gap}")
        self._last_chain = step
        try:
            hashes = _decode_chain(data).hashes
        except MessageError as exc:
            self.gaps.append(f"{layout.CHAIN_TOPIC}: step {step} is {exc}")
            return
        for name, expected in hashes.items():
            participant = self._participants.get(name)
            if participant is not None and not participant.reaches(step, expected):
                self.gaps += participant.silences(0)
                self.gaps.append(f"{name}: the hash chain breaks at or before step {step}")
            if participant is not None:
                participant.go_on(step, expected)


class _Participant:
    """One participant: its hash chain, and what it published since that was last confirmed."""

    def __init__(self, name: str, every: int) -> None:
        self._name = name
        self._every = every
        self._chain = HashChain()
        self._next = 0
        self._steps: dict[int, list[tuple[str, bytes]]] = {}
        self._ports: dict[str, tuple[int, int]] = {}
        self._gaps: list[tuple[str, int, int, int]] = []

    def take(self, port: str, step: int, data: bytes) -> None:
        self._steps.setdefault(step, []).append((port, data))
        last, count = self._ports.get(port, (step - self._every, 0))
        if step != last + self._every:
            self._gaps.append((port, last, step, count))
            count = 0
        self._ports[port] = (step, count + 1)

    def reaches(self, last: int, expected: str) -> bool:
        """Extend the chain up to a recorded value; in a run that failed it ends before `last`."""
        published = self._steps
        while not self._stands_at(expected) and self._next <= last:
            self._chain.extend(self._next, published.pop(self._next, ()))
            self._next += self._every
        return self._stands_at(expected)

    def _stands_at(self, expected: str) -> bool:
        return not self._steps and self._chain.value.hex() == expected

    def go_on(self, step: int, expected: str) -> None:
        """Take a recorded value for granted, so that each hole is found once."""
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


def _every(scenario: bytes | None) -> Mapping[str, int]:
    """Return participant → its `every`, as far as a resolved scenario says it."""
    with contextlib.suppress(
        StepbusError, UnicodeDecodeError, KeyError, TypeError, AttributeError, ValueError
    ):
        rows = parse_yaml(layout.SCENARIO_ATTACHMENT, (scenario or b"").decode())["participants"]
        return {name: max(1, int(row.get("every", 1))) for name, row in rows.items()}
    return {}
