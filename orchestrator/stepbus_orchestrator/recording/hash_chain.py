"""The hash chain of one participant (P13.2), and the hash of all messages (P13.3)."""

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
