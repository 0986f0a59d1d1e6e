"""The hash chain of one participant (P13.2)."""

import hashlib
from collections.abc import Iterable


class HashChain:
    """Sums up all outputs of a participant so far in one SHA-256.

    Two recordings with equal values have equal outputs up to there. value: 32 bytes, zero at first.
    """

    def __init__(self) -> None:
        self.value = bytes(32)

    def extend(self, step: int, published: Iterable[tuple[str, bytes]]) -> None:
        """Take in one step. published: (port, recorded bytes), in the order of the scenario."""
        digest = hashlib.sha256(self.value)
        digest.update(step.to_bytes(8, "little", signed=True))
        for port, data in published:
            digest.update(port.encode())
            digest.update(data)
        self.value = digest.digest()
