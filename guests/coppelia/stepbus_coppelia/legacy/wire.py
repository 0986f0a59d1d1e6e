"""The frames of the legacy remote API.

A message goes in packets, each behind u16 1 (it shows the byte order), u16 its size and u16 how
many follow. It is a header and commands; a command is a header, what names it (handles or
zero-terminated texts) and its data. All numbers are little-endian.
"""

import struct
from collections.abc import Iterator, Sequence
from typing import NamedTuple

MOST_BYTES = 64 << 20
"""Longest message, and most that a client may have sent of commands not yet complete."""
_MOST_COMMANDS, _MOST_PARTS = 4096, 64
"""Most commands in a message, which run before another client is served; most incomplete ones."""
_LONGEST_PACKET, _VERSION = 30000, 11
"""The client reads the size of a packet as a signed number."""
STREAMING, STREAMING_SPLIT, DISCONTINUE = 2, 4, 5
"""Modes of commands."""

_PACKET = struct.Struct("<HHH")
_HEADER = struct.Struct("<HBiiiHB")
"""Checksum (unused), version, number, client's and server's time [ms], scene, state."""
_COMMAND = struct.Struct("<iiHiiHiBB")
"""Size, size of the whole, of the name, place of the data in the whole, number and mode, period
[ms] or longest part, simulation time [ms], whether it failed, unused."""

Origin = tuple[int, int]
"""Number and client's time [ms] of a message, as its answer repeats them."""


class FrameError(Exception):
    """A client breaks the rules, or has gone; the text follows its name."""


class Command(NamedTuple):
    """A command, or the answer to it. period: of a stream [ms]."""

    number: int
    mode: int
    name: bytes
    data: bytes = b""
    period: int = 0
    failed: bool = False


class Inbox:
    """What has arrived from a client."""

    def __init__(self) -> None:
        self.bytes = bytearray()
        self._message = bytearray()
        self._parts: dict[tuple[int, bytes], bytearray] = {}

    def message(self) -> tuple[Origin, list[Command]] | None:
        """Return the next message, if it is complete. Raises FrameError."""
        while len(self.bytes) >= _PACKET.size:
            one, size, follow = _PACKET.unpack_from(self.bytes)
            if one != 1:
                raise FrameError(f"sent a packet that starts with {one} instead of 1")
            end = _PACKET.size + size
            if len(self.bytes) < end:
                break
            self._message += self.bytes[_PACKET.size : end]
            del self.bytes[:end]
            if len(self._message) > MOST_BYTES:
                raise FrameError(f"sent a message of more than {MOST_BYTES} bytes")
            if not follow:
                message, self._message = bytes(self._message), bytearray()
                if len(message) < _HEADER.size:
                    raise FrameError(f"sent a message of {len(message)} bytes")
                return _HEADER.unpack_from(message)[2:4], list(self._commands(message))
        return None

    def _commands(self, message: bytes) -> Iterator[Command]:
        end = _HEADER.size
        for _ in range(_MOST_COMMANDS):
            at, data_at = end, end + _COMMAND.size
            if at == len(message):
                return
            if data_at > len(message):
                raise FrameError(f"sent a command of {len(message) - at} bytes")
            size, whole, named, place, code, period, *_ = _COMMAND.unpack_from(message, at)
            data_at, end = data_at + named, at + size
            if not data_at <= end <= len(message) or not size <= whole <= MOST_BYTES:
                raise FrameError(f"sent a command of {size} of {whole} bytes, {named} its name")
            number, mode = code & 0xFFFF, code >> 16
            name, data = message[data_at - named : data_at], message[data_at:end]
            if size == whole:
                yield Command(number, mode, name, data, period if mode == STREAMING else 0)
            elif self._completes(part := (number, name), data, place, whole):
                yield Command(number, mode, name, bytes(self._parts.pop(part)))
        raise FrameError(f"sent more than {_MOST_COMMANDS} commands at once")

    def _completes(self, key: tuple[int, bytes], data: bytes, place: int, whole: int) -> bool:
        """Add a part of a command; return whether that was the last."""
        part = self._parts.setdefault(key, bytearray())
        del part[place:]
        part += data
        if sum(map(len, self._parts.values())) > MOST_BYTES or len(self._parts) > _MOST_PARTS:
            raise FrameError(f"sent more than {MOST_BYTES} bytes of incomplete commands")
        return len(part) + len(key[1]) + _COMMAND.size >= whole


def packets(origin: Origin, time_ms: int, state: int, answers: Sequence[Command]) -> bytes:
    """Return an answer to a message. time_ms: simulation time. state: bits of the header."""
    parts = [_HEADER.pack(0, _VERSION, *origin, time_ms, 0, state)]
    for number, mode, name, data, _, failed in answers:
        size, code = _COMMAND.size + len(name) + len(data), number | mode << 16
        head = _COMMAND.pack(size, size, len(name), 0, code, 0, time_ms, failed, 0)
        parts += head, name, data
    whole, length = b"".join(parts), _LONGEST_PACKET - _PACKET.size
    chunks = [whole[start : start + length] for start in range(0, len(whole), length)]
    left = range(len(chunks) - 1, -1, -1)
    return b"".join(
        _PACKET.pack(1, len(chunk), n) + chunk for chunk, n in zip(chunks, left, strict=True)
    )
