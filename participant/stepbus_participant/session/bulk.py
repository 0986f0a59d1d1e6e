"""The attachment of a bulk sample: the step and run it belongs to (P7.5)."""


def stamp(step: int, token: str) -> bytes:
    """Return the attachment: the step as int64 little-endian, then the token."""
    return step.to_bytes(8, "little", signed=True) + token.encode()


def read_stamp(attachment: bytes, token: str) -> int | None:
    """Return the step of a bulk sample, or None where it is not of this run."""
    if attachment[8:] != token.encode():
        return None
    return int.from_bytes(attachment[:8], "little", signed=True)
