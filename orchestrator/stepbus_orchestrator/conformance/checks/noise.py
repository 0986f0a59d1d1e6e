"""Checks of messages that a participant must drop, as if they had never arrived."""

from __future__ import annotations

import random
from collections.abc import Callable

import msgspec

from stepbus_orchestrator.conformance.check import Check
from stepbus_orchestrator.conformance.harness.feeds import Feed, Ports
from stepbus_orchestrator.conformance.harness.harness import Harness
from stepbus_orchestrator.conformance.harness.kit import Kit
from stepbus_orchestrator.conformance.outcome import Skipped
from stepbus_orchestrator.run.kernel.admission import max_message_bytes
from stepbus_schemas import Outputs, Start, Stop, Trigger, encode

_OTHER_RUN = "1234567890abcdef"
_LAST_LOG_S = 0.05
Noise = Callable[[Harness, int], None]


def _undisturbed(kit: Kit, noise: Noise, what: str) -> str:
    """Make noise before and after the inputs of some steps; the outputs stay the same."""
    kit.reference()

    def play(harness: Harness) -> None:
        for step in range(kit.steps):
            harness.release(step + 1)
            noise(harness, step)
            harness.feed(kit.material.feed, step)
            noise(harness, step)
            harness.await_output(step)
        # What it says to have dropped comes with its last log; nobody demands it.
        harness.idle(_LAST_LOG_S)

    trace = kit.play(play=play)
    kit.same(trace, what)
    counted = ", ".join(f"{cause} {count}" for cause, count in trace.transcript.drops.items())
    return f"the same outputs; it counts as dropped: {counted or 'nothing'}"


def _to_all(make: Callable[[Harness, str, int], bytes | None]) -> Noise:
    """Return noise that each source makes."""

    def noise(harness: Harness, step: int) -> None:
        for source in harness.material.feed:
            data = make(harness, source, step)
            if data is not None:
                harness.publish_bytes(source, data)

    return noise


def _outputs(harness: Harness, source: str, step: int, token: str | None = None) -> bytes | None:
    """Return what a source publishes at a step, None where it does not fire."""
    ports = harness.material.feed[source].get(step)
    if ports is None:
        return None
    return encode(
        Outputs(
            token=token or harness.token,
            step=step,
            t_ns=step * harness.scenario.step_ns,
            ports={port: msgspec.Raw(data) for port, data in ports.items()},
        )
    )


def duplicate(kit: Kit) -> str:
    """Send each message of the sources once more."""
    kit.need_inputs()
    kit.reference()

    def play(harness: Harness) -> None:
        for step in range(kit.steps):
            harness.release(step + 1)
            harness.feed(kit.material.feed, step)
            harness.feed(kit.material.feed, step)
            harness.await_output(step)

    kit.same(kit.play(play=play), "with duplicates")
    return "the same outputs"


def stale(kit: Kit) -> str:
    """Send messages of older steps again."""
    kit.need_inputs()
    kit.reference()

    def play(harness: Harness) -> None:
        for step in range(kit.steps):
            harness.release(step + 1)
            harness.feed(kit.material.feed, step)
            for source, rows in kit.material.feed.items():
                older = [s for s in rows if s < step]
                for s in older[-3:-1]:
                    harness.publish(source, s, rows[s])
            harness.await_output(step)

    kit.same(kit.play(play=play), "with stale messages")
    return "the same outputs"


def garbage(kit: Kit) -> str:
    """Send bytes that are no map with the token; also right ones cut off, or with more behind."""
    kit.need_inputs()
    pieces = _garbage()

    def make(harness: Harness, source: str, step: int) -> bytes | None:
        right = _outputs(harness, source, step) or b""
        spoiled = [right[:-1], right + b"\x00", right + right]
        return [*spoiled, *pieces][step % (len(pieces) + len(spoiled))]

    return _undisturbed(kit, _to_all(make), "with garbage")


def _garbage() -> list[bytes]:
    chance = random.Random(0)  # noqa: S311
    return [
        b"",
        b"\xc1",
        b"\x91" * 20_000,
        b"\xdd\xff\xff\xff\xff",
        b"\x81\xa5token",
        b"null",
        msgspec.msgpack.encode([1, 2, 3]),
        msgspec.msgpack.encode({"token": 5, "step": 0}),
        b"\x81\xa5token\xa2\xff\xfe",
        *(chance.randbytes(length) for length in (1, 10, 100, 1000)),
    ]


def unauthenticated(kit: Kit) -> str:
    """Send right outputs with another run's token, with other content."""
    kit.need_inputs()
    noise = _to_all(lambda harness, source, step: _outputs(harness, source, step, _OTHER_RUN))
    return _undisturbed(kit, noise, "with messages of another run")


def control_noise(kit: Kit) -> str:
    """Send Stop, Start and Trigger with another token, and garbage on their keys."""
    messages: list[tuple[str, bytes]] = [
        ("stop", encode(Stop(token=_OTHER_RUN, reason="another run", at_step=-1))),
        ("trigger", encode(Trigger(token=_OTHER_RUN, step_limit=1 << 40))),
        ("start", encode(Start(token=_OTHER_RUN, inputs={}))),
        *((key, data) for data in _garbage() for key in ("stop", "trigger", "start")),
    ]

    def noise(harness: Harness, step: int) -> None:
        for channel, data in messages[step % 4 :: 4]:
            harness.send_control(channel, data)

    return _undisturbed(kit, noise, "with an unauthenticated Stop, Trigger and Start")


def _with_ports(kit: Kit, ports: Ports) -> Feed:
    return {
        source: {step: {**ports, **row} for step, row in rows.items()}
        for source, rows in kit.material.feed.items()
    }


def unread_ports(kit: Kit) -> str:
    """Add ports that it does not read, with anything in them."""
    kit.need_inputs()
    strange = {
        "conformance_map": msgspec.msgpack.encode({"position": "many"}),
        "conformance_nil": b"\xc0",
        "conformance_list": msgspec.msgpack.encode([1.5, None, b"\x00\xff"]),
    }
    kit.same(kit.play(_with_ports(kit, strange)), "with more ports")
    return "ignored"


def oversize(kit: Kit) -> str:
    """Make each message of the sources as large as the bus allows."""
    kit.need_inputs()
    limit = min(max_message_bytes(kit.material.scenario), 60_000)
    own = max(
        sum(map(len, row.values())) for rows in kit.material.feed.values() for row in rows.values()
    )
    room = limit - own - 500
    if room < 1:
        raise Skipped(f"its inputs of {own} bytes are as large as the bus allows already")
    kit.reference()
    filler = {"conformance_filler": msgspec.msgpack.encode(bytes(room))}
    kit.same(kit.play(_with_ports(kit, filler)), "with large messages")
    return f"messages of {limit - 500} bytes and more: the same outputs"


CHECKS = (
    Check(
        name="duplicate",
        clause="P8.1",
        summary="duplicate messages change nothing",
        run=duplicate,
    ),
    Check(
        name="stale",
        clause="P8.1",
        summary="messages of older steps change nothing",
        run=stale,
    ),
    Check(
        name="garbage",
        clause="P8.1",
        summary="bytes without the token change nothing",
        run=garbage,
    ),
    Check(
        name="unauthenticated",
        clause="P8.1",
        summary="messages with another token change nothing",
        run=unauthenticated,
    ),
    Check(
        name="control-noise",
        clause="P8.4",
        summary="unauthenticated or malformed `Stop`, `Start`, `Trigger` change nothing",
        run=control_noise,
    ),
    Check(
        name="unread-ports",
        clause="P8.2",
        summary="ports it does not read change nothing, whatever they contain",
        run=unread_ports,
    ),
    Check(
        name="oversize",
        clause="P3.7",
        summary="messages as large as the bus allows change nothing",
        run=oversize,
    ),
)
