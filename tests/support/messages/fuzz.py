"""Messages of every kind, broken in seeded ways, and a bus that hands them over by hand."""

from __future__ import annotations

import random
import time
from dataclasses import dataclass, field
from queue import SimpleQueue
from typing import Any

import msgspec

from stepbus_participant import stamp
from stepbus_schemas import (
    Decoder,
    Fault,
    Hello,
    Log,
    MessageError,
    Outputs,
    Ready,
    Start,
    Stop,
    Trigger,
    Waiting,
    encode,
)

TOKEN = "00c0ffee00c0ffee"
OLD_TOKEN = "0ddba11500000000"
STEP_NS = 5_000_000
ODD = [None, True, -1, 0, 1.5, 2**63, -(2**63), "", "\x00", "x" * 300, b"\xff", [], {}, [[]], {"": None}]  # fmt: skip


def outputs(step: int = 0, token: str = TOKEN) -> Outputs:
    port = msgspec.Raw(msgspec.msgpack.encode({"mode": "torque", "values": [0.5, 1.0]}))
    return Outputs(token=token, step=step, t_ns=step * STEP_NS, ports={"command": port})


def envelopes(token: str = TOKEN) -> dict[str, Any]:
    """Return one message for each key that carries an envelope."""
    raw = msgspec.Raw(encode(outputs(token=token)))
    waiting = Waiting(step=1, sources=["plant"])
    return {
        "join": Hello(protocol=2, name="controller", token=token, pid=7, outputs={"command": "JointCommand/1"}),
        "ready/controller": Ready(name="controller", token=token, versions={"numpy": "2"}),
        "log/controller": Log(name="controller", token=token, outputs=[raw], timing=[(0, 1, 2)], waiting=waiting),
        "fault/controller": Fault(name="controller", token=token, step=0, type="raised", message="no"),
        "start": Start(token=token, inputs={"controller": {}}),
        "trigger": Trigger(token=token, step_limit=1000),
        "stop": Stop(token=token, reason="no more", at_step=-1),
        "out/controller": outputs(token=token),
    }  # fmt: skip


@dataclass(frozen=True)
class Sample:
    """A sample of the hand-made bus; also a query, which is answered once."""

    key: str
    payload: bytes
    attachment: bytes = b""
    replies: list[bytes] = field(default_factory=list)

    def reply(self, data: bytes, encoding: str) -> None:
        self.replies.append(data)


class HandBus:
    """A bus without a network: `hand` gives a sample to whoever listens to its key."""

    clock, exchange = time, None
    queue = SimpleQueue

    def __init__(self) -> None:
        self.sinks: dict[str, Any] = {}

    def every(self, period_s, call):
        return lambda: None

    def publisher(self, key, encoding, *, remote=False):
        return lambda data, attachment=b"": None

    def subscribe(self, key, sink):
        self.sinks[key] = sink

    answer = watch_alive = subscribe

    def subscribe_content(self, key, sink):
        self.sinks[key] = lambda sample: sink(sample.payload)

    def declare_alive(self, key):
        self.alive = key

    def hand(self, sample: Sample) -> None:
        first, *rest = sample.key.split("/")
        wild = "/".join([first, *("*" for _ in rest)])
        self.sinks.get(sample.key, self.sinks.get(wild))(sample)


class Mutator:
    """Breaks messages; one seed gives one sequence."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)

    def broken(self, message: Any, token: str | None = None) -> bytes:
        """Return bytes that are no message of the run any more.

        token: what the run's would be; a mutant that is still a message with it is thrown away.
        """
        data, decode = encode(message), Decoder(type(message))
        while True:
            mutant = self.mutant(data)
            try:
                if decode(mutant).token != (token or TOKEN):
                    return mutant
            except MessageError:
                return mutant

    def mutant(self, data: bytes) -> bytes:
        """Return data with one to three changes to its bytes or its values."""
        for _ in range(self.random.randint(1, 3)):
            change = self.random.choice([self.flip, self.cut, self.put, self.replace, self.replace])
            data = change(data)
        return data

    def flip(self, data: bytes) -> bytes:
        at = self.random.randrange(len(data) or 1)
        return data[:at] + bytes([self.random.randrange(256)]) + data[at + 1 :]

    def cut(self, data: bytes) -> bytes:
        return data[: self.random.randrange(len(data) or 1)]

    def put(self, data: bytes) -> bytes:
        at = self.random.randrange(len(data) or 1)
        return data[:at] + self.random.randbytes(self.random.randint(1, 9)) + data[at:]

    def replace(self, data: bytes) -> bytes:
        """Replace or remove one value, or give it another run's token."""
        try:
            content = msgspec.msgpack.decode(data)
        except (msgspec.MsgspecError, UnicodeDecodeError):
            return data
        if not isinstance(content, dict) or not content:
            return data
        key = self.random.choice(list(content))
        value = self.random.choice([*ODD, OLD_TOKEN, key])
        changed = {**content, key: value}
        if self.random.random() < 0.2:
            del changed[key]
        return msgspec.msgpack.encode(changed)

    def broken_stamp(self) -> bytes:
        """Return an attachment of bulk content that has not the run's token."""
        while True:
            mutant = self.mutant(stamp(0, self.random.choice([TOKEN, OLD_TOKEN, ""])))
            if mutant[8:] != TOKEN.encode():
                return mutant
