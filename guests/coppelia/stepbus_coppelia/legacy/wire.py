"""The frames of the legacy remote API.

A message goes in packets, each behind u16 1 (which shows the byte order), u16 its size and u16 how
many follow. It is a header and commands; a command is a header, what identifies it (handles or
zero-terminated names) and its data. All numbers are little-endian.
"""

import struct
from collections.abc import Iterator, Sequence
from typing import NamedTuple

MOST_BYTES = 64 << 20
"""Longest message, and most that a client may have sent of commands not yet complete."""
_MOST_COMMANDS = 4096
"""Most commands in a message: they run before another client is served."""

# mode of a command
STREAMING, STREAMING_SPLIT, DISCONTINUE = 2, 4, 5

_PACKET = struct.Struct("<HHH")
_HEADER = struct.Struct("<HBiiiHB")
"""checksum (unused), version, message, client's time, server's time [ms], scene, state."""
_COMMAND = struct.Struct("<iiHiiHiBB")
"""size, size of the whole, of what identifies it, offset of the data, mode and number, period [ms]
or longest part, simulation time [ms], flags, unused."""
_VERSION = 11
_LONGEST_PACKET = 30000 - _PACKET.size
"""The client reads the size as a signed number."""


class FrameError(Exception):
    """A client breaks the rules of the frames; the text ends a sentence about it."""


class Command(NamedTuple):
    """A command. period: of a stream [ms]."""

    number: int
    identity: bytes
    data: bytes = b""
    mode: int = 0
    period: int = 0


class Answer(NamedTuple):
    """The answer to a command."""

    command: Command
    data: bytes = b""
    failed: bool = False


class Inbox:
    """What has arrived from a client."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._message = bytearray()
        self._parts: dict[tuple[int, bytes], bytearray] = {}

    def add(self, data: bytes) -> None:
        """Take bytes as they arrive."""
        self._bytes += data

    def message(self) -> tuple[tuple[int, int], list[Command]] | None:
        """Return the next message: its number and its client's time, and its commands.

        None: it is not yet complete. Raises FrameError.
        """
        while len(self._bytes) >= _PACKET.size:
            one, size, follow = _PACKET.unpack_from(self._bytes)
            if one != 1:
                raise FrameError(f"sent a packet that starts with {one} instead of 1")
            end = _PACKET.size + size
            if len(self._bytes) < end:
                break
            self._message += self._bytes[_PACKET.size : end]
            del self._bytes[:end]
            if len(self._message) > MOST_BYTES:
                raise FrameError(f"sent a message of more than {MOST_BYTES} bytes")
            if not follow:
                message, self._message = bytes(self._message), bytearray()
                return self._read(message)
        return None

    def _read(self, message: bytes) -> tuple[tuple[int, int], list[Command]]:
        if len(message) < _HEADER.size:
            raise FrameError(f"sent a message of {len(message)} bytes, less than its header")
        _, _, number, time_ms, *_ = _HEADER.unpack_from(message)
        commands = list(self._commands(message))
        if len(commands) > _MOST_COMMANDS:
            raise FrameError(f"sent {len(commands)} commands at once; {_MOST_COMMANDS} may be")
        return (number, time_ms), commands

    def _commands(self, message: bytes) -> Iterator[Command]:
        at = _HEADER.size
        while at < len(message):
            room = len(message) - at - _COMMAND.size
            if room < 0:
                raise FrameError(f"sent a command of {room + _COMMAND.size} bytes")
            size, whole, named, offset, code, period, *_ = _COMMAND.unpack_from(message, at)
            start, end = at + _COMMAND.size, at + size
            if not start + named <= end <= len(message) or not size <= whole <= MOST_BYTES:
                raise FrameError(f"sent a command of {size} bytes (whole {whole}, name {named})")
            identity = message[start : start + named]
            data: bytes | None = message[start + named : end]
            number, mode = code & 0xFFFF, code >> 16
            if size < whole:
                data = self._whole((number, identity), message[start + named : end], offset, whole)
            if data is not None:
                period = period if mode == STREAMING else 0
                yield Command(number, identity, data, mode, period)
            at = end

    def _whole(self, key: tuple[int, bytes], data: bytes, offset: int, size: int) -> bytes | None:
        """Add a part of a command; return the data if that was the last."""
        part = self._parts.setdefault(key, bytearray())
        if not offset:
            part.clear()
        if offset != len(part):
            raise FrameError(f"sent byte {offset} of a command's data after byte {len(part)}")
        part += data
        if sum(map(len, self._parts.values())) > MOST_BYTES or len(self._parts) > _MOST_COMMANDS:
            raise FrameError(f"sent more than {MOST_BYTES} bytes of incomplete commands")
        if len(part) + len(key[1]) + _COMMAND.size < size:
            return None
        return bytes(self._parts.pop(key))


def packets(message: tuple[int, int], time_ms: int, state: int, answers: Sequence[Answer]) -> bytes:
    """Return an answer to a message, in packets.

    message: its number and its client's time. time_ms: simulation time. state: bits of the header.
    """
    parts = [_HEADER.pack(0, _VERSION, *message, time_ms, 0, state)]
    for (number, identity, _, mode, _), data, failed in answers:
        size = _COMMAND.size + len(identity) + len(data)
        code = number | mode << 16
        head = _COMMAND.pack(size, size, len(identity), 0, code, 0, time_ms, failed, 0)
        parts += head, identity, data
    whole = b"".join(parts)
    starts = range(0, len(whole), _LONGEST_PACKET)
    chunks = (whole[start : start + _LONGEST_PACKET] for start in starts)
    left = range(len(starts) - 1, -1, -1)
    return b"".join(
        _PACKET.pack(1, len(chunk), follow) + chunk
        for chunk, follow in zip(chunks, left, strict=True)
    )
