"""Which protocol numbers are spoken (P14)."""

import msgspec

from .protocol import PROTOCOL_VERSION, Hello


class Protocols(msgspec.Struct, frozen=True):
    """A range of protocol numbers, with both ends; empty where lowest > highest."""

    lowest: int
    highest: int

    def __str__(self) -> str:
        """Return `protocol 2`, or `protocols 2 to 3`."""
        if self.lowest == self.highest:
            return f"protocol {self.highest}"
        return f"protocols {self.lowest} to {self.highest}"

    def common(self, other: "Protocols") -> int | None:
        """Return the highest number that is in both ranges; None where there is none."""
        lowest, highest = max(self.lowest, other.lowest), min(self.highest, other.highest)
        return highest if lowest <= highest else None


SPOKEN = Protocols(PROTOCOL_VERSION, PROTOCOL_VERSION)
"""What the orchestrator and the participants of this library speak."""


def offered(hello: Hello) -> Protocols:
    """Return the numbers that a program speaks."""
    lowest = hello.lowest_protocol
    return Protocols(hello.protocol if lowest is None else lowest, hello.protocol)
