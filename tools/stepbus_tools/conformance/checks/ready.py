"""Checks of handshakes, descriptions and the start."""

from collections.abc import Mapping
from typing import Any

from stepbus_schemas import Description, Ready
from stepbus_tools.conformance.check import check
from stepbus_tools.conformance.feeds import reverse_description
from stepbus_tools.conformance.harness import Harness
from stepbus_tools.conformance.kit import Kit, Trace
from stepbus_tools.conformance.material import Setup
from stepbus_tools.conformance.outcome import Failed


@check("P4.6", "it sends handshakes, `Log` and `Ready` until `Start`, and no step before")
def handshake(kit: Kit) -> str:
    """Listen to its handshakes, and to what comes before Ready."""
    with kit.ready() as harness:
        transcript = harness.transcript
        count, readies = transcript.handshakes + 2, len(transcript.readies) + 2
        harness.until(
            lambda: transcript.handshakes >= count and len(transcript.readies) >= readies,
            "another handshake and Ready before the Start",
            kit.spec.deadlines.step_s,
            harness.send_handshake,
        )
        if "P4.6" in transcript.problems:
            raise Failed(transcript.problems["P4.6"])
        bulk = {port for port, output in kit.spec.outputs.items() if output.bulk}
        if missing := sorted(bulk - transcript.bulk_handshakes):
            raise Failed(f"it sent no handshake on bulk port {missing[0]}")
        if not transcript.log_before_ready:
            raise Failed("its first Ready came without a Log before it")
        if transcript.outputs:
            raise Failed(f"it published step {transcript.newest} before the Start")
    return "empty handshakes and Ready, each repeated"


@check("P2.2", "peers that start first, on a link of their own, change nothing", inputs=True)
def peers_first(kit: Kit) -> str:
    """Let the peers be there, on a link of their own, before the program starts."""
    kit.unchanged("with peers that were there first", setup=Setup(own_peers=True))
    return "the same outputs"


@check(
    "P4.6", "it waits for late peers, reports them, and publishes the same", inputs=True, plain=True
)
def peers_last(kit: Kit) -> str:
    """Let the peers come, on a link of their own, once it waits for them."""
    with kit.joined(Setup(own_peers=True)) as harness:
        sources, transcript = set(kit.feed), harness.transcript
        harness.until(
            lambda: transcript.waits(-1, sources) or transcript.readies,
            f"a Log with waiting step −1 and sources {sorted(sources)}",
            kit.spec.deadlines.ready_s,
        )
        if transcript.readies:
            raise Failed(f"it got ready without a handshake of {sorted(sources)}")
        harness.open_peers()
        harness.await_ready()
        harness.start()
        harness.walk(kit.feed, 0, kit.steps)
        kit.same(Trace.of(transcript), "with late peers")
    return "named its source, then the same outputs"


@check("P4.7", "names, limits and `like` of its outputs are consistent")
def descriptions(kit: Kit) -> str:
    """Check what it says of its outputs."""
    with kit.ready() as harness:
        ready = harness.transcript.readies[0]
    for port, description in ready.outputs.items():
        problem = _description_problem(kit, port, description)
        if problem:
            raise Failed(f"its description of {port!r} {problem}")
    return ", ".join(f"{port}: {_names(ready, port)}" for port in kit.spec.outputs) or "no outputs"


def _description_problem(kit: Kit, port: str, item: Description) -> str | None:
    if port not in kit.spec.outputs:
        return "is of no port of the scenario"
    if len(set(item.names)) != len(item.names):
        return f"repeats a name: {item.names}"
    if item.like is not None and item.like not in kit.spec.inputs:
        return f"is like {item.like!r}, which is no input of it"
    # Where it is `like` an input, that one's names count.
    names = item.names if item.like is None else kit.material.descriptions[item.like].names
    rows: Mapping[str, list[Any]] = {**item.limits, **item.details}
    for key, row in rows.items():
        if len(row) != len(names):
            return f"has {len(row)} values of {key} for {len(names)} names"
    return None


def _names(ready: Ready, port: str) -> str:
    item = ready.outputs.get(port, Description())
    return f"like {item.like}" if item.like else (", ".join(item.names) or "no names")


@check("P4.8", "later `Start`s change nothing, also with other descriptions")
def start_again(kit: Kit) -> str:
    """Send a second Start later, with the joints in another order."""
    # Only one input: with all of them turned, a program that uses them might go unnoticed.
    turned = dict(kit.material.descriptions)
    for name, description in list(turned.items())[:1]:
        turned[name] = reverse_description(description)

    def play(harness: Harness) -> None:
        harness.walk(kit.feed, 0, kit.middle)
        harness.start()
        harness.start(turned)
        harness.walk(kit.feed, kit.middle, kit.steps)

    kit.unchanged("after another Start", play=play)
    return "two more, one with other descriptions, changed nothing"


@check("P4.9", "it keeps a trigger and outputs that arrive before the `Start`", plain=True)
def early(kit: Kit) -> str:
    """Send trigger and outputs before the Start, and handshakes behind it."""
    with kit.ready() as harness:
        harness.release(1)
        harness.feed(kit.feed, 0)
        harness.send_handshake()
        harness.start()
        harness.await_output(0)
        harness.send_handshake()
        harness.walk(kit.feed, 1, kit.steps)
        kit.same(Trace.of(harness.transcript), "in this order")
    return "kept the trigger and step 0, ignored the handshakes"
