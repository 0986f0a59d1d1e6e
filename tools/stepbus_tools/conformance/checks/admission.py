"""Checks from the ticket to the start: `Hello`, refusals, handshakes, descriptions."""

import os
import time
from collections.abc import Mapping
from typing import Any

from msgspec.structs import replace

from stepbus_orchestrator.processes.child import Child
from stepbus_orchestrator.run.kernel.admission import welcome_of
from stepbus_participant import TICKET_VARIABLE
from stepbus_schemas import (
    SPOKEN,
    Description,
    Hello,
    Protocols,
    Refusal,
    Types,
    WiringError,
    offered,
)
from stepbus_tools.conformance.harness import Harness
from stepbus_tools.conformance.kit import Check, Kit, check
from stepbus_tools.conformance.material import Setup, reverse_description
from stepbus_tools.conformance.transcript import Failed, Skipped

_LATE_S = 0.5
_UNKNOWN = 1000
"""A protocol number that no program speaks."""


@check("P1.1", "without a ticket, it exits with a non-zero code")
def _no_ticket(kit: Kit) -> str:
    variables = {k: v for k, v in os.environ.items() if k != TICKET_VARIABLE}
    logs = kit.log_folder() / "no_ticket.log"
    child = Child(kit.spec.name, kit.command, cwd=kit.cwd, log=logs, environment=variables)
    limit_s = kit.spec.deadlines.spawn_s
    try:
        if not child.wait(limit_s):
            raise Failed(f"it still runs after {limit_s:g} s without a ticket")
        return _refused(child.exit_code() or 0, "without a ticket")
    finally:
        child.end()


def _refused(code: int, when: str) -> str:
    if code == 0:
        raise Failed(f"it exited with code 0 {when}, as if nothing had failed")
    return f"exited with code {code} {when}"


@check("P4.2", "it declares itself alive, then sends a valid `Hello`")
def _join(kit: Kit) -> str:
    with kit.joined() as harness:
        transcript, name = harness.transcript, kit.spec.name
    hello = transcript.hello
    if "P4.2" in transcript.problems or hello is None:
        raise Failed(transcript.problem("P4.2") or "no Hello")
    if not transcript.alive_before_hello:
        raise Failed(f"it asked to join before it declared its liveliness token alive/{name}")
    if (hello.name, hello.token) != (name, harness.token):
        right = "right" if hello.token == harness.token else "wrong"
        raise Failed(
            f"its Hello has the name {hello.name!r} and a {right} token; it must have the "
            f"ticket's name, {name!r}, and token"
        )
    return f"Hello from {hello.language or 'no language'}, {_spoken(hello)}"


def _spoken(hello: Hello) -> Protocols:
    """Return the protocol numbers of a program; raises Failed where ours is not among them."""
    program = offered(hello)
    if program.common(SPOKEN) is None:
        raise Failed(f"its Hello names {program}; expected: {SPOKEN}, or a range that includes it")
    return program


@check("P14.1", "it accepts a ticket that names later protocol versions")
def _later_protocols(kit: Kit) -> str:
    later = Protocols(SPOKEN.lowest, _UNKNOWN)
    with kit.joined(Setup(protocols=later)) as harness:
        hello = harness.transcript.hello
        if hello is None:
            raise Failed(harness.transcript.problem("P4.2") or "no Hello")
        program = _spoken(hello)
        harness.await_ready()
    return f"speaks {program}, also where the ticket names {later}"


@check("P14.3", "the ports in its `Hello`, if any, are the scenario's")
def _port_types(kit: Kit) -> str:
    with kit.joined() as harness:
        hello = harness.transcript.hello
    welcome = welcome_of(kit.material.scenario, kit.spec, "")
    if hello is None or (hello.inputs is None and hello.outputs is None):
        raise Skipped("its Hello names no ports, so the scenario's ports apply")
    for direction in ("inputs", "outputs"):
        named = getattr(hello, direction)
        wanted = {port: item.type for port, item in getattr(welcome, direction).items()}
        if named is not None and named != wanted:
            raise Failed(f"its Hello names the {direction} {named}, the scenario has {wanted}")
    try:
        misfits = Types(hello.types).misfits(Types(welcome.types), "the program", "the scenario")
    except WiringError as exc:
        raise Failed(f"its Hello has invalid types: {exc}") from exc
    if misfits:
        raise Failed(f"its Hello: {misfits[0]}")
    return "its Hello names the ports of the scenario"


@check("P4.2", "it repeats its query until the orchestrator answers")
def _orchestrator_late(kit: Kit) -> str:
    with kit.harness() as harness:
        harness.start_program()
        time.sleep(_LATE_S)
        harness.open_bus()
        harness.await_join()
        harness.await_ready()
    return "joined and became ready"


@check("P4.2", "it gives up after `join_timeout_s`")
def _nobody_answers(kit: Kit) -> str:
    with kit.harness(Setup(join_timeout_s=1.0)) as harness:
        harness.start_program()
        # Starting takes its time, and the last query may start just before the time is over.
        limit_s = kit.spec.deadlines.spawn_s + 2.0
        code = harness.await_end("its start; join is not answered, join_timeout_s is 1", limit_s)
    return _refused(code, "when join was not answered for 1 s")


@check("P4.2", "it takes the valid `Welcome` where another process replies as well", inputs=True)
def _wrong_replies(kit: Kit) -> str:
    limits = kit.spec.deadlines
    with kit.harness(Setup(own_peers=True)) as harness:
        harness.open_bus()
        harness.open_peers(replying=True)
        harness.start_program()
        harness.until(
            lambda: harness.transcript.asked,
            "a query that reaches both processes on `join` (Zenoh's target ALL)",
            limits.spawn_s + limits.join_s,
            harness.drop_queries,
        )
        harness.await_ready()
    return "joined, with garbage and a Refusal before the Welcome, and one after"


def _not_let_in(name: str, what: str, setup: Setup) -> Check:
    """Return the check of an answer to `Hello` that has to end the participant."""

    def run(kit: Kit) -> str:
        with kit.joined(setup) as harness:
            code = harness.await_end(what, kit.spec.deadlines.join_s, harness.player.send_handshake)
            if harness.transcript.readies:
                raise Failed(f"it became ready after {what}")
        return _refused(code, f"after {what}")

    summary = f"after {what}, it exits with a non-zero code"
    return Check(name=name, clause="P4.3", summary=summary, run=run)


_REFUSED = _not_let_in(
    "refused",
    "a `Refusal`",
    Setup(answer=lambda _: Refusal(reason="the conformance kit refuses you")),
)
_WELCOME_PROTOCOL = _not_let_in(
    "welcome-protocol",
    "a `Welcome` of a protocol that it does not speak",
    Setup(answer=lambda welcome: replace(welcome, protocol=_UNKNOWN)),
)
_WELCOME_NAME = _not_let_in(
    "welcome-name",
    "a `Welcome` for another name",
    Setup(answer=lambda welcome: replace(welcome, name="another")),
)
_WELCOME_TOKEN = _not_let_in(
    "welcome-token",
    "a `Welcome` with another token",
    Setup(answer=lambda welcome: replace(welcome, token="0" * 16)),
)


@check("P4.6", "it sends handshakes, `Log` and `Ready` until `Start`, and no step before")
def _handshake(kit: Kit) -> str:
    with kit.running(None) as harness:
        transcript = harness.transcript
        count, readies = transcript.handshakes + 2, len(transcript.readies) + 2
        harness.until(
            lambda: transcript.handshakes >= count and len(transcript.readies) >= readies,
            "another handshake and Ready before the Start",
            tick=harness.player.send_handshake,
        )
    if problem := transcript.problem("P4.6"):
        raise Failed(problem)
    bulk = {port for port, output in kit.spec.outputs.items() if output.bulk}
    if missing := sorted(bulk - transcript.bulk_handshakes):
        raise Failed(f"it sent no handshake on bulk port {missing[0]}")
    if not transcript.log_before_ready:
        raise Failed("its first Ready came without a Log before it")
    if transcript.outputs:
        raise Failed(f"it published step {transcript.newest} before the Start")
    return "empty handshakes and Ready, each repeated"


@check("P2.2", "peers that start first, on a separate link, change nothing", inputs=True)
def _peers_first(kit: Kit) -> str:
    return kit.unchanged("with peers that start first", setup=Setup(own_peers=True))


@check(
    "P4.6", "it waits for late peers, reports them, and publishes the same", inputs=True, plain=True
)
def _peers_last(kit: Kit) -> str:
    with kit.joined(Setup(own_peers=True)) as harness:
        sources, transcript = set(kit.feed), harness.transcript
        harness.until(
            lambda: transcript.waits(-1, sources) or transcript.readies,
            f"a Log with waiting step −1 and sources {sorted(sources)}",
            kit.spec.deadlines.ready_s,
        )
        if transcript.readies:
            raise Failed(f"it became ready without a handshake of {sorted(sources)}")
        harness.open_peers()
        harness.await_ready()
        harness.start()
        harness.walk(kit.feed, 0, kit.steps)
    kit.same(transcript, "with late peers")
    return "named its source, then the same outputs"


@check("P4.7", "names, limits and `like` of its outputs are consistent")
def _descriptions(kit: Kit) -> str:
    with kit.running(None) as harness:
        outputs = harness.transcript.readies[0].outputs
    for port, description in outputs.items():
        if problem := _problem(kit, port, description):
            raise Failed(f"its description of {port!r} {problem}")

    def shown(port: str) -> str:
        item = outputs.get(port, Description())
        return f"like {item.like}" if item.like else ", ".join(item.names) or "no names"

    return ", ".join(f"{port}: {shown(port)}" for port in kit.spec.outputs) or "no outputs"


def _problem(kit: Kit, port: str, item: Description) -> str | None:
    if port not in kit.spec.outputs:
        return "is not for a port of the scenario"
    if len(set(item.names)) != len(item.names):
        return f"has a repeated name: {item.names}"
    if item.like is not None and item.like not in kit.spec.inputs:
        return f"is like {item.like!r}, which is not one of its inputs"
    # Where it is `like` an input, that one's names count.
    names = item.names if item.like is None else kit.material.descriptions[item.like].names
    rows: Mapping[str, list[Any]] = {**item.limits, **item.details}
    for key, row in rows.items():
        if len(row) != len(names):
            return f"has {len(row)} values of {key} for {len(names)} names"
    return None


@check("P4.8", "later `Start`s change nothing, also with other descriptions")
def _start_again(kit: Kit) -> str:
    # Only one input: with all of them turned, a program that uses them might go unnoticed.
    turned = dict(kit.material.descriptions)
    for name, description in list(turned.items())[:1]:
        turned[name] = reverse_description(description)

    def start(harness: Harness, step: int) -> None:
        if step == kit.middle:
            harness.start()
            harness.start(turned)

    kit.unchanged("after another Start", before=start)
    return "two more, one with other descriptions, changed nothing"


@check("P4.9", "it keeps a trigger and outputs that arrive before the `Start`", plain=True)
def _early(kit: Kit) -> str:
    with kit.running(None) as harness:
        harness.release(1)
        harness.feed(kit.feed, 0)
        harness.player.send_handshake()
        harness.start()
        harness.await_output(0)
        harness.player.send_handshake()
        harness.walk(kit.feed, 1, kit.steps)
    kit.same(harness.transcript, "in this order")
    return "kept the trigger and step 0, ignored the handshakes"
