"""What the orchestrator and the agent on another host send each other, over SSH.

Each frame is its length in four bytes, and a MessagePack map with its type.
"""

import os
from collections.abc import Iterator
from typing import Any

import msgspec

from stepbus_participant import Endpoint

MARK = b"stepbus agent 1\n"
"""The first that the agent sends; what the user's shell prints before it is passed over."""
_HEAD = 4


class Frame(msgspec.Struct, tag=True, omit_defaults=True):
    """What is sent."""


class Open(Frame):
    """To the agent, first of all. files: of the scenario, name → SHA-256; folder: its cache."""

    run: str
    token: str
    lease_s: float
    folder: str
    files: dict[str, str]


class Content(Frame):
    """To the agent: files that it lacks, SHA-256 → content."""

    files: dict[str, bytes]


class Start(Frame):
    """To the agent: a participant to start. fields: of its ticket."""

    name: str
    program: tuple[str, ...]
    join_timeout_ns: int
    endpoint: Endpoint
    fields: dict[str, Any]


class Signal(Frame):
    """To the agent: a signal for a participant, and all that it has started."""

    name: str
    number: int


class Probe(Frame):
    """To the agent: bytes to send to a port, where there is one, to tell what that is like."""

    host: str = ""
    port: int = 0
    proof: bytes = b""


class Close(Frame):
    """To the agent: end all."""


class Beat(Frame):
    """Both ways, so that silence is a lost link."""


class Greeting(Frame):
    """From the agent, first of all. origin: the address that has reached it; empty: unknown."""

    versions: dict[str, str]
    origin: str
    missing: list[str]


class Probed(Frame):
    """From the agent: how long the port took to answer, or the problem; its clock."""

    clock_s: float
    took_s: float
    problem: str


class Started(Frame):
    """From the agent: a participant was started, or could not be (problem)."""

    name: str
    pid: int = 0
    problem: str = ""


class Printed(Frame):
    """From the agent: what a participant has printed."""

    name: str
    text: bytes


class Ended(Frame):
    """From the agent: a participant has ended; code: negative for a signal."""

    name: str
    code: int


class Left(Frame):
    """From the agent, last of all: (participant, warning) of what it had to end."""

    rows: list[tuple[str, str]]


class Problem(Frame):
    """From the agent: why it ends."""

    text: str


_Any = (
    Open | Content | Start | Signal | Probe | Close | Beat | Greeting | Probed | Started | Printed
    | Ended | Left | Problem
)  # fmt: skip
_decoder = msgspec.msgpack.Decoder(_Any)


def packed(frame: Frame) -> bytes:
    """Return a frame as bytes."""
    body = msgspec.msgpack.encode(frame)
    return len(body).to_bytes(_HEAD, "big") + body


class Frames:
    """Reads frames from a descriptor. mark: what comes before the first. longest: [bytes]."""

    def __init__(self, descriptor: int, mark: bytes = b"", longest: int = 1 << 31) -> None:
        self._descriptor, self._mark, self._longest = descriptor, mark, longest
        self._buffer = bytearray()

    def read(self) -> Iterator[Any]:
        """Read once, and yield the frames that are complete; raises EOFError at the end.

        Raises ValueError for what is no frame.
        """
        data = os.read(self._descriptor, 1 << 20)
        if not data:
            raise EOFError
        self._buffer += data
        if self._mark:
            place = self._buffer.find(self._mark)
            if place < 0:
                return
            del self._buffer[: place + len(self._mark)]
            self._mark = b""
        while len(self._buffer) >= _HEAD:
            length = int.from_bytes(self._buffer[:_HEAD], "big")
            if length > self._longest:
                raise ValueError(f"a frame of {length} bytes")
            if len(self._buffer) < _HEAD + length:
                return
            body = bytes(self._buffer[_HEAD : _HEAD + length])
            del self._buffer[: _HEAD + length]
            yield _decoder.decode(body)
