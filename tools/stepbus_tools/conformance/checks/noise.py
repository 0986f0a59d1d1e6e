"""Checks of messages that a participant must drop, as if they had never arrived."""

import random
from collections.abc import Callable
from functools import partial

import msgspec

from stepbus_orchestrator.run.kernel.admission import max_message_bytes
from stepbus_schemas import Start, Stop, Trigger, encode
from stepbus_tools.conformance.check import check
from stepbus_tools.conformance.feeds import Feed, Ports
from stepbus_tools.conformance.harness import Harness
from stepbus_tools.conformance.kit import Kit
from stepbus_tools.conformance.outcome import Skipped

_OTHER_RUN = "1234567890abcdef"
_LAST_LOG_S = 0.05
Noise = Callable[[Harness, int], None]


def _undisturbed(kit: Kit, noise: Noise, what: str) -> str:
    """Make noise before and after the inputs of some steps; the outputs stay the same."""

    def play(harness: Harness) -> None:
        for step in range(kit.steps):
            harness.release(step + 1)
            noise(harness, step)
            harness.feed(kit.feed, step)
            noise(harness, step)
            harness.await_output(step)
        # What it says to have dropped comes with its last log; nobody demands it.
        harness.idle(_LAST_LOG_S)

    drops = kit.unchanged(what, play=play).transcript.drops
    counted = ", ".join(f"{cause} {count}" for cause, count in drops.items())
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
    return harness.outputs(source, step, ports, token)[0]


@check("P8.1", "duplicate messages change nothing", inputs=True)
def duplicate(kit: Kit) -> str:
    """Send each message of the sources once more."""
    return _with_more(kit, "with duplicates", lambda harness, step: harness.feed(kit.feed, step))


@check("P8.1", "messages of older steps change nothing", inputs=True)
def stale(kit: Kit) -> str:
    """Send messages of older steps again."""

    def more(harness: Harness, step: int) -> None:
        for source, rows in kit.feed.items():
            older = [s for s in rows if s < step]
            for s in older[-3:-1]:
                harness.publish(source, s, rows[s])

    return _with_more(kit, "with stale messages", more)


def _with_more(kit: Kit, what: str, more: Noise) -> str:
    """Send more behind the inputs of each step."""
    kit.unchanged(what, play=lambda h: h.walk(kit.feed, 0, kit.steps, partial(more, h)))
    return "the same outputs"


@check("P8.1", "bytes without the token change nothing", inputs=True)
def garbage(kit: Kit) -> str:
    """Send bytes that are no map with the token; also right ones cut off, or with more behind."""
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


@check("P8.1", "messages with another token change nothing", inputs=True)
def unauthenticated(kit: Kit) -> str:
    """Send right outputs with another run's token, with other content."""
    noise = _to_all(lambda harness, source, step: _outputs(harness, source, step, _OTHER_RUN))
    return _undisturbed(kit, noise, "with messages of another run")


@check("P8.4", "unauthenticated or malformed `Stop`, `Start`, `Trigger` change nothing")
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
        for source, rows in kit.feed.items()
    }


@check("P8.2", "ports it does not read change nothing, whatever they contain", inputs=True)
def unread_ports(kit: Kit) -> str:
    """Add ports that it does not read, with anything in them."""
    strange = {
        "conformance_map": msgspec.msgpack.encode({"position": "many"}),
        "conformance_nil": b"\xc0",
        "conformance_list": msgspec.msgpack.encode([1.5, None, b"\x00\xff"]),
    }
    kit.unchanged("with more ports", _with_ports(kit, strange))
    return "ignored"


@check("P3.7", "messages as large as the bus allows change nothing", inputs=True)
def oversize(kit: Kit) -> str:
    """Make each message of the sources as large as the bus allows."""
    scenario = kit.material.scenario
    bulk = {n: {p for p, o in scenario.participant(n).outputs.items() if o.bulk} for n in kit.feed}
    own = max(
        sum(len(data) for port, data in row.items() if port not in bulk[name])
        for name, rows in kit.feed.items()
        for row in rows.values()
    )
    limit = min(max_message_bytes(scenario), 60_000)
    room = limit - own - 500
    if room < 1:
        raise Skipped(f"its inputs of {own} bytes are as large as the bus allows already")
    filler = {"conformance_filler": msgspec.msgpack.encode(bytes(room))}
    kit.unchanged("with large messages", _with_ports(kit, filler))
    return f"messages of {limit - 500} bytes and more: the same outputs"
