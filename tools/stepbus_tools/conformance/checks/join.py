"""Checks of the admission: ticket, `Hello`, refusals."""

import os
import time
from typing import Any

from stepbus_orchestrator.processes.child import Child
from stepbus_participant import TICKET_VARIABLE
from stepbus_schemas import PROTOCOL_VERSION, Types, WiringError
from stepbus_tools.conformance.check import check
from stepbus_tools.conformance.kit import Kit
from stepbus_tools.conformance.material import Setup
from stepbus_tools.conformance.outcome import Failed, Skipped

_LATE_S = 0.5


@check("P1.1", "without a ticket it ends with a code other than 0")
def no_ticket(kit: Kit) -> str:
    """Start the program without a ticket."""
    environment = {k: v for k, v in os.environ.items() if k != TICKET_VARIABLE}
    logs = kit.log_folder() / "no_ticket.log"
    child = Child(kit.spec.name, kit.command, cwd=kit.cwd, log=logs, environment=environment)
    limit_s = kit.spec.deadlines.spawn_s
    try:
        if not child.wait(limit_s):
            raise Failed(f"it still runs after {limit_s:g} s without a ticket")
        return _refused(child.exit_code() or 0, "without a ticket")
    finally:
        child.end()


def _refused(code: int, when: str) -> str:
    if code == 0:
        raise Failed(f"it exited with code 0 {when}, as if all were well")
    return f"ended with code {code} {when}"


@check("P4.2", "it declares itself alive, then sends a valid `Hello`")
def join(kit: Kit) -> str:
    """Let it join."""
    with kit.joined() as harness:
        transcript, name = harness.transcript, kit.spec.name
        hello = transcript.hello
        if "P4.2" in transcript.problems or hello is None:
            raise Failed(transcript.problems.get("P4.2", "no Hello"))
        if not transcript.alive_before_hello:
            raise Failed(f"it asked to join before its liveliness token alive/{name} was there")
        if (hello.name, hello.token, hello.protocol) != (name, harness.token, PROTOCOL_VERSION):
            right = "right" if hello.token == harness.token else "wrong"
            raise Failed(
                f"its Hello is of {hello.name!r}, protocol {hello.protocol}, with a {right} "
                f"token; due are {name!r}, {PROTOCOL_VERSION}, right"
            )
        return f"Hello from {hello.language or 'no language'}, protocol {PROTOCOL_VERSION}"


@check("P14.3", "the ports in its `Hello`, if any, are the scenario's")
def port_types(kit: Kit) -> str:
    """Compare the ports it reports with those of the scenario."""
    with kit.joined() as harness:
        hello = harness.transcript.hello
    welcome: Any = Setup().answer(kit.material.scenario, kit.spec, "")
    if hello is None or (hello.inputs is None and hello.outputs is None):
        raise Skipped("its Hello names no ports, so that it takes those of the scenario")
    for direction in ("inputs", "outputs"):
        named = getattr(hello, direction)
        wanted = {port: item.type for port, item in getattr(welcome, direction).items()}
        if named is not None and named != wanted:
            raise Failed(f"its Hello names the {direction} {named}, the scenario has {wanted}")
    try:
        misfits = Types(hello.types).misfits(Types(welcome.types), "the program", "the scenario")
    except WiringError as exc:
        raise Failed(f"its Hello has types that are none: {exc}") from exc
    if misfits:
        raise Failed(f"its Hello: {misfits[0]}")
    return "its Hello names the ports of the scenario"


@check("P4.2", "it repeats its query until the orchestrator is there")
def orchestrator_late(kit: Kit) -> str:
    """Open the bus half a second after the program has started."""
    with kit.harness() as harness:
        harness.start_program()
        time.sleep(_LATE_S)
        harness.open_bus()
        harness.await_join()
        harness.await_ready()
    return "joined and got ready"


@check("P4.2", "it gives up after `join_timeout_s`")
def nobody_answers(kit: Kit) -> str:
    """Give it a ticket to a run in which nobody answers."""
    with kit.harness(Setup(join_timeout_s=1.0)) as harness:
        harness.start_program()
        # Starting takes its time, and the last query may start just before the time is over.
        limit_s = kit.spec.deadlines.spawn_s + 2.0
        code = harness.await_end("its start; nobody answers, join_timeout_s is 1", limit_s)
    return _refused(code, "when nobody answered for 1 s")


def _not_let_in(kit: Kit, setup: Setup, when: str) -> str:
    with kit.joined(setup) as harness:
        code = harness.await_end(when, kit.spec.deadlines.join_s, harness.send_handshake)
        if harness.transcript.readies:
            raise Failed(f"it got ready {when}")
    return _refused(code, f"after {when}")


@check("P4.3", "a `Refusal` (version, types, token) ends it, with a code other than 0")
def refused(kit: Kit) -> str:
    """Refuse it, as the orchestrator does for wrong versions, types or tokens."""
    return _not_let_in(kit, Setup(refusal="the conformance kit refuses you"), "a Refusal")


@check("P4.3", "so does a `Welcome` of another protocol version")
def welcome_protocol(kit: Kit) -> str:
    """Welcome it in another version of the protocol."""
    other = PROTOCOL_VERSION + 1
    return _not_let_in(kit, Setup(welcome={"protocol": other}), f"a Welcome of protocol {other}")


@check("P4.3", "so does a `Welcome` for another name")
def welcome_name(kit: Kit) -> str:
    """Welcome another participant."""
    return _not_let_in(kit, Setup(welcome={"name": "somebody"}), "a Welcome for another name")


@check("P4.3", "so does a `Welcome` with another token")
def welcome_token(kit: Kit) -> str:
    """Welcome it with another run's token."""
    setup = Setup(welcome={"token": "0000000000000000"})
    return _not_let_in(kit, setup, "a Welcome with another token")
