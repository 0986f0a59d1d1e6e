"""The bus of a participant that shares this process."""

from collections.abc import Callable, Sequence
from typing import Any

from stepbus_participant import FaultyPublisher, LoopbackBus, MessageFault


class HostedBus(LoopbackBus):
    """A participant's bus in memory, with faults in the outputs that have any.

    peer: the orchestrator's. is_leaf: it has no link to other participants. counter: where
    to count the outputs that it has published, and the index there.
    """

    def __init__(
        self,
        peer: LoopbackBus,
        name: str,
        faults: Sequence[MessageFault],
        *,
        counter: "tuple[memoryview[float], int]",
        is_leaf: bool = False,
    ) -> None:
        super().__init__(peer, peer.queue, is_leaf=is_leaf)
        self._counter = counter
        self._key = f"out/{name}"
        self._faults = list(faults)

    def publisher(self, key: str, encoding: str, *, remote: bool = False) -> Callable[..., None]:
        """Return a function that publishes bytes; it counts outputs, and makes them faulty."""
        put = super().publisher(key, encoding, remote=remote)
        if key != self._key:
            return put
        if self._faults:
            put = FaultyPublisher(put, self._faults)

        counts, index = self._counter

        def counted_put(data: bytes, **options: Any) -> None:
            counts[index] += 1
            put(data, **options)

        return counted_put
