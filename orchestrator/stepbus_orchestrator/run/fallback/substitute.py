"""Publishes for a participant that has failed: its last messages, then safe ones, then the end."""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from stepbus_orchestrator.scenario import HoldSpec, ParticipantSpec
from stepbus_schemas import SHIPPED, Decoder, Description, MessageError, Outputs, Types, encode

from .safe_messages import MOMENTARY, safe_message

_decode_outputs = Decoder(Outputs)


class Substitute:
    """Replaces one participant when it has failed, from the first step that it owes.

    Until then it follows what the participant publishes: once the process is gone, nobody else
    knows what has reached its consumers.

    put: publishes on the participant's key. log: gets the same bytes, as the orchestrator gets
    those of the participant's log. types: of the scenario.
    """

    def __init__(
        self,
        spec: ParticipantSpec,
        hold: HoldSpec,
        *,
        token: str,
        step_ns: int,
        put: Callable[[bytes], None],
        log: Callable[[bytes], None],
        types: Types = SHIPPED,
    ) -> None:
        self._types = types
        self._spec = spec
        self._hold = hold
        self._token = token
        self._step_ns = step_ns
        self._put = put
        self._log = log
        self._published: deque[tuple[int, bytes]] = deque()
        self._last: Mapping[str, Any] = {}
        self._safe: Mapping[str, Any] = {}
        self._next = 0
        self._until = 0
        self._repeat_until = 0

    def take(self, data: bytes) -> None:
        """Take what was published on the participant's key; what is not its own is ignored."""
        try:
            outputs = _decode_outputs(data)
        except MessageError:
            return
        if outputs.token == self._token and outputs.step == self._next:
            self._published.append((outputs.step, data))
            self._last = {**self._last, **outputs.ports}
            self._next += self._spec.every

    def forget(self, reported: int) -> None:
        """Forget what has been reported in the log, but for the newest."""
        while len(self._published) > 1 and self._published[0][0] <= reported:
            self._published.popleft()

    def take_over(self, reported: int, descriptions: Mapping[str, Description]) -> tuple[int, int]:
        """Return the first step that is published from here, and the one the run ends before.

        reported: the newest step in the participant's log; what it published after that is logged
        now, and published again for those it did not reach. descriptions: of its outputs.
        """
        for step, data in self._published:
            self._put(data)
            if step > reported:
                self._log(data)
        self._next = max(self._next, reported + self._spec.every)
        ports = [p for p, output in self._spec.outputs.items() if output.type not in MOMENTARY]
        self._last = {port: self._last[port] for port in ports if port in self._last}
        self._safe = self._safe_messages(descriptions)
        self._repeat_until = self._next + -(-self._hold.keep_ns // self._step_ns)
        self._until = self._repeat_until + -(-self._hold.hold_ns // self._step_ns)
        return self._next, self._until

    def _safe_messages(self, descriptions: Mapping[str, Description]) -> dict[str, bytes]:
        messages = {
            port: safe_message(
                output.type,
                descriptions.get(port, Description()),
                self._hold.safe.get(port),
                self._last.get(port),
                self._types,
            )
            for port, output in self._spec.outputs.items()
        }
        return {port: encode(message) for port, message in messages.items() if message is not None}

    def publish_below(self, step_limit: int) -> None:
        """Publish what is due at all steps below `step_limit`."""
        while self._next < min(step_limit, self._until):
            ports = self._last if self._next < self._repeat_until else self._safe
            outputs = Outputs(
                token=self._token,
                step=self._next,
                t_ns=self._next * self._step_ns,
                ports={port: msgspec.Raw(bytes(data)) for port, data in ports.items()},
            )
            data = encode(outputs)
            self._put(data)
            self._next += self._spec.every
            self._log(data)
