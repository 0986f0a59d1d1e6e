"""Checks of messages that a participant must drop, as if they had never arrived."""

import random
from collections.abc import Callable

import msgspec

from stepbus_orchestrator.run.kernel.admission import max_message_bytes
from stepbus_orchestrator.run.player import Ports
from stepbus_schemas import Start, Stop, Trigger, encode
from stepbus_tools.conformance.harness import Harness, Hook
from stepbus_tools.conformance.kit import Kit, check
from stepbus_tools.conformance.material import each_step
from stepbus_tools.conformance.transcript import Skipped

_OTHER_RUN = "1234567890abcdef"
_LAST_LOG_S = 0.05
_LATE_S = 0.1


@check("P8.1", "duplicate messages change nothing", inputs=True)
def _duplicate(kit: Kit) -> str:
    return kit.unchanged("with duplicates", after=lambda h, step: h.feed(kit.feed, step))


@check("P8.1", "messages of older steps change nothing", inputs=True)
def _stale(kit: Kit) -> str:
    def send_older(harness: Harness, step: int) -> None:
        for source, rows in kit.feed.items():
            older = [s for s in rows if s < step]
            for s in older[-3:-1]:
                harness.publish(source, s, rows[s])

    return kit.unchanged("with stale messages", after=send_older)


def _undisturbed(kit: Kit, noise: Hook, what: str) -> str:
    """Make noise before and after the inputs of all steps; the outputs stay the same."""

    def play(harness: Harness) -> None:
        harness.walk(kit.feed, 0, kit.steps, before=noise, after=noise)
        # What it says to have dropped comes with its last log, which no clause demands.
        harness.idle(_LAST_LOG_S)

    transcript = kit.play(play=play)
    kit.same(transcript, what)
    drops = transcript.logs[-1].drops if transcript.logs else {}
    counted = ", ".join(f"{cause} {count}" for cause, count in drops.items())
    return f"the same outputs; it reports as dropped: {counted or 'nothing'}"


def _from_all(make: Callable[[Harness, str, int], bytes | None]) -> Hook:
    """Return noise that each source makes."""

    def noise(harness: Harness, step: int) -> None:
        for source in harness.material.feed:
            data = make(harness, source, step)
            if data is not None:
                harness.player.puts[source](data)

    return noise


def _outputs(harness: Harness, source: str, step: int, token: str | None = None) -> bytes | None:
    """Return what a source publishes at a step, None where it does not fire."""
    ports = harness.material.feed[source].get(step)
    return None if ports is None else harness.outputs(source, step, ports, token)[0]


@check("P8.1", "bytes without the token change nothing", inputs=True)
def _garbage(kit: Kit) -> str:
    """Send bytes that are no map with the token; also maps cut off or with bytes after them."""
    pieces = _pieces()

    def make(harness: Harness, source: str, step: int) -> bytes | None:
        right = _outputs(harness, source, step) or b""
        spoiled = [right[:-1], right + b"\x00", right + right]
        return [*spoiled, *pieces][step % (len(pieces) + len(spoiled))]

    return _undisturbed(kit, _from_all(make), "with garbage")


def _pieces() -> list[bytes]:
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
def _unauthenticated(kit: Kit) -> str:
    noise = _from_all(lambda harness, source, step: _outputs(harness, source, step, _OTHER_RUN))
    return _undisturbed(kit, noise, "with messages of another run")


@check("P8.4", "unauthenticated or malformed `Stop`, `Start`, `Trigger` change nothing")
def _control_noise(kit: Kit) -> str:
    messages: list[tuple[str, bytes]] = [
        ("stop", encode(Stop(token=_OTHER_RUN, reason="another run", at_step=-1))),
        ("trigger", encode(Trigger(token=_OTHER_RUN, step_limit=1 << 40))),
        ("start", encode(Start(token=_OTHER_RUN, inputs={}))),
        *((key, data) for data in _pieces() for key in ("stop", "trigger", "start")),
    ]

    def noise(harness: Harness, step: int) -> None:
        for channel, data in messages[step % 4 :: 4]:
            harness.control[channel](data)

    return _undisturbed(kit, noise, "with an unauthenticated Stop, Trigger and Start")


@check("P8.2", "ports it does not read change nothing, whatever they contain", inputs=True)
def _unread_ports(kit: Kit) -> str:
    strange: Ports = {
        "conformance_map": msgspec.msgpack.encode({"position": "many"}),
        "conformance_nil": b"\xc0",
        "conformance_list": msgspec.msgpack.encode([1.5, None, b"\x00\xff"]),
    }
    kit.unchanged("with more ports", each_step(kit.feed, lambda _s, _k, row: {**strange, **row}))
    return "ignored"


@check("P3.7", "messages as large as the bus allows change nothing", inputs=True)
def _oversize(kit: Kit) -> str:
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
    kit.unchanged("with large messages", each_step(kit.feed, lambda _s, _k, row: {**filler, **row}))
    return f"messages of {limit - 500} bytes and more: the same outputs"


# --- bulk content ------------------------------------------------------------------------------


def bulk_inputs(kit: Kit) -> dict[str, set[str]]:
    """Return source → its bulk ports that the participant reads; raises Skipped without any."""
    ports: dict[str, set[str]] = {}
    for item in kit.spec.inputs.values():
        if kit.material.scenario.participant(item.source).outputs[item.port].bulk:
            ports.setdefault(item.source, set()).add(item.port)
    if not ports:
        raise Skipped("it has no bulk inputs")
    return ports


@check("P6.5", "bulk content that comes after its `Outputs` changes nothing", inputs=True)
def _bulk_late(kit: Kit) -> str:
    bulk, late = bulk_inputs(kit), {1, kit.middle}
    in_time = {
        source: {s: row for s, row in rows.items() if source not in bulk or s not in late}
        for source, rows in kit.feed.items()
    }

    def send_late(harness: Harness, step: int) -> None:
        rows = {source: kit.feed[source][step] for source in bulk if step in kit.feed[source]}
        if step not in late:
            return
        packed = {source: harness.outputs(source, step, ports) for source, ports in rows.items()}
        for source, (outputs, _) in packed.items():
            harness.player.puts[source](outputs)
        harness.idle(_LATE_S)
        for source, (_, content) in packed.items():
            for port, data in content.items():
                harness.player.publish_content(source, port, step, data)

    kit.unchanged("with late bulk content", in_time, after=send_late)
    return "waited for the content: the same outputs"


@check("P8.3", "bulk content of another run, or of another step, changes nothing", inputs=True)
def _bulk_noise(kit: Kit) -> str:
    ports = [(source, port) for source, ports in bulk_inputs(kit).items() for port in ports]

    def noise(harness: Harness, step: int) -> None:
        for source, port in ports:
            harness.player.publish_content(source, port, step, b"\xc1", token=_OTHER_RUN)
            if step > 1:
                harness.player.publish_content(source, port, step - 2, b"\x80")

    return kit.unchanged("with bulk content of another run and step", before=noise)
