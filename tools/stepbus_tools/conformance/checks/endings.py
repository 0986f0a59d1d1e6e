"""Checks of slots, and of how it ends: by a fault of the right source, a stop or a signal."""

import signal
from collections.abc import Callable, Collection

import msgspec

from stepbus_orchestrator.run.player import Ports
from stepbus_schemas import Fault
from stepbus_tools.conformance.checks.noise import bulk_inputs
from stepbus_tools.conformance.harness import Harness
from stepbus_tools.conformance.kit import Check, Kit, check
from stepbus_tools.conformance.material import Setup
from stepbus_tools.conformance.transcript import Failed, Skipped

Spoil = Callable[[Harness, str, int, Ports], None]
"""Publishes something wrong on behalf of a source, at a step where its outputs are due."""

_TERM_S = 1.0
# By then it waits: it has nothing else to do.
_WAITING_S = 0.1


# --- faults -------------------------------------------------------------------------------------


def _ports_of(kit: Kit) -> dict[str, set[str]]:
    """Return source → its ports that the participant reads."""
    return {
        source: {item.port for item in kit.spec.inputs.values() if item.source == source}
        for source in kit.feed
    }


def _fatal(
    name: str,
    clause: str,
    when: str,
    spoil: Spoil,
    *,
    ports_of: Callable[[Kit], dict[str, set[str]]] = _ports_of,
    setup: Setup | None = None,
) -> Check:
    """Return the check of an input that is fatal: each source publishes it in turn."""

    def run(kit: Kit) -> str:
        rows = ports_of(kit).items()
        return "; ".join(_blames(kit, source, spoil, ports, setup) for source, ports in rows)

    summary = f"it reports a fault of the source {when}"
    return Check(name=name, clause=clause, summary=summary, run=run, inputs=True, plain=True)


def _blames(
    kit: Kit, source: str, spoil: Spoil, ports: Collection[str], setup: Setup | None
) -> str:
    """Spoil a step in the middle at which a source publishes one of some ports.

    Return the fault that the participant reports; raises Failed where it does not blame the source.
    """
    steps = [s for s, row in kit.feed[source].items() if any(port in row for port in ports)]
    if not steps:
        raise Skipped(f"{source} publishes nothing that it reads")
    at = steps[len(steps) // 2]
    with kit.running(at, setup) as harness:
        fault = harness.fault_during(lambda: _walk_to_fault(kit, harness, source, at, spoil))
        if fault is None:
            raise Failed(f"it did all {kit.steps} steps, and reported no fault of {source}")
        _check_fault(harness, fault, source)
        return f"{source}: {fault.message[:100]}"


def _walk_to_fault(kit: Kit, harness: Harness, source: str, at: int, spoil: Spoil) -> None:
    # All peers continue, so that it meets what is wrong, however late it checks.
    harness.release(kit.steps)
    for step in range(at, kit.steps):
        for name, rows in kit.feed.items():
            if name == source and step == at:
                spoil(harness, name, step, rows[step])
            elif step in rows:
                harness.publish(name, step, rows[step])
    transcript = harness.transcript
    harness.until(
        lambda: transcript.faults or transcript.newest >= kit.steps - kit.spec.every,
        "a Fault",
        tick=harness.repeat,
        faults=True,
    )
    if not transcript.faults:
        # One that publishes first may take in its last inputs only now.
        harness.idle(0.2)


def _check_fault(harness: Harness, fault: Fault, source: str) -> None:
    if fault.blames != source:
        blamed = fault.blames or "no participant"
        raise Failed(f"its fault blames {blamed}, not {source}: {fault.message}")
    harness.idle(0.05)
    transcript = harness.transcript
    if transcript.logged != transcript.packed:
        raise Failed(
            f"{len(transcript.packed)} Outputs were published before the fault and "
            f"{len(transcript.logged)} logged (P10.1)"
        )
    harness.stop(-1)
    # It may wait for the Stop, though not for long (P10.1).
    limit_s = harness.spec.deadlines.stop_s + 1.0
    code = harness.await_end("the Stop after its fault", limit_s, harness.session.repeat_stop)
    if code == 0:
        raise Failed("it exited with code 0 after a fault (P10.1)")


# --- bulk content in files that the participants share -----------------------------------------

_SLOTS = Setup(has_slots=True)


@check("P17.3", "bulk content in slots changes nothing", plain=True)
def _slots(kit: Kit) -> str:
    if not any(output.bulk for output in kit.spec.outputs.values()):
        bulk_inputs(kit)
    transcript = kit.play(setup=_SLOTS)
    named = transcript.readies[-1].slots
    if not named:
        raise Skipped("its Ready names no slots: its bulk content travels in messages")
    kit.same(transcript, "with bulk content in slots")
    own = {port for port in kit.spec.outputs if f"{kit.spec.name}.{port}" in named}
    for step, outputs in transcript.outputs.items():
        if in_messages := own & outputs.bulk.keys() - outputs.slots.keys():
            raise Failed(f"step {step}: it has slots for {min(in_messages)}, and uses none")
    return f"{', '.join(named)}: the same outputs"


def _slot_inputs(kit: Kit) -> dict[str, set[str]]:
    """Return source → its ports that the participant reads from slots."""
    bulk = bulk_inputs(kit)
    with kit.running(setup=_SLOTS) as harness:
        named = harness.transcript.readies[-1].slots
    used = {s: {p for p in ports if f"{s}.{p}" in named} for s, ports in bulk.items()}
    if not any(used.values()):
        raise Skipped("its Ready names none of its bulk inputs")
    return {source: ports for source, ports in used.items() if ports}


def _publish_late(harness: Harness, source: str, step: int, ports: Ports) -> None:
    harness.publish(source, step, ports, late=1)


_SLOT_STAMP = _fatal(
    "slot-stamp",
    "P17.4",
    "if a slot does not hold the announced step",
    _publish_late,
    ports_of=_slot_inputs,
    setup=_SLOTS,
)


# --- wrong inputs -----------------------------------------------------------------------------


def _publish_twice(harness: Harness, source: str, step: int, ports: Ports) -> None:
    harness.publish(source, step, ports)
    harness.publish(source, step, {})


def _publish_nothing(_harness: Harness, _source: str, _step: int, _ports: Ports) -> None: ...


def _publish_malformed(harness: Harness, source: str, step: int, ports: Ports) -> None:
    bad = {"token": harness.token, "step": "seven", "t_ns": 0}
    harness.player.puts[source](msgspec.msgpack.encode(bad))
    harness.publish(source, step, ports)


def _publish_mistyped(harness: Harness, source: str, step: int, ports: Ports) -> None:
    # No field of any type may be an empty map.
    bad = {
        port: msgspec.msgpack.encode({key: {} for key in msgspec.msgpack.decode(data)})
        for port, data in ports.items()
    }
    harness.publish(source, step, bad)


def _publish_too_long(harness: Harness, source: str, step: int, ports: Ports) -> None:
    outputs, content = harness.outputs(source, step, ports)
    for port, data in content.items():
        harness.player.publish_content(source, port, step, data + b"\x00")
    harness.player.puts[source](outputs)


_CHANGED_DUPLICATE = _fatal(
    "changed-duplicate", "P8.1", "if a step is repeated with other bytes", _publish_twice
)
_SKIPPED_STEP = _fatal("skipped-step", "P8.1", "if a step is skipped", _publish_nothing)
_MALFORMED_OUTPUTS = _fatal(
    "malformed-outputs",
    "P8.1",
    "for a malformed `Outputs` with the right token",
    _publish_malformed,
)
_WRONG_MESSAGE = _fatal(
    "wrong-message", "P8.2", "for a due message of the wrong type", _publish_mistyped
)
_BULK_LENGTH = _fatal(
    "bulk-length",
    "P8.3",
    "if bulk content does not have the announced length",
    _publish_too_long,
    ports_of=bulk_inputs,
)


# --- stops and signals -------------------------------------------------------------------------


def _stops(harness: Harness, at_step: int, when: str) -> str:
    """Stop it and check its exit code."""
    harness.stop(at_step)
    limit_s = harness.spec.deadlines.stop_s
    # Sent again, as the orchestrator does.
    code = harness.await_end(f"the Stop {when}", limit_s, harness.session.repeat_stop)
    faults = harness.transcript.faults
    if faults:
        raise Failed(f"a Stop {when} made it report a fault: {faults[0].message}")
    if code != 0:
        raise Failed(
            f"it {harness.child.how_it_ended()} after the Stop {when}{harness.last_output()}"
        )
    return "exit code 0"


@check("P11.1", "a stop while it waits for its sources: exit code 0", inputs=True)
def _stop_before_ready(kit: Kit) -> str:
    with kit.joined() as harness:
        limit_s = kit.spec.deadlines.ready_s
        harness.until(lambda: harness.transcript.handshakes, "a handshake", limit_s)
        return _stops(harness, -1, "before it was ready")


@check("P11.1", "a stop when it is ready: exit code 0")
def _stop_before_start(kit: Kit) -> str:
    with kit.running(None) as harness:
        return _stops(harness, -1, "before the Start")


@check("P11.1", "a stop while it waits for inputs: exit code 0", inputs=True, plain=True)
def _stop_while_waiting(kit: Kit) -> str:
    with kit.running(kit.middle) as harness:
        harness.release(kit.steps)
        harness.idle(_WAITING_S)
        return _stops(harness, -1, "while it waits for a source")


@check("P11.1", "a repeated stop while it waits for the trigger: exit code 0", plain=True)
def _stop_between_steps(kit: Kit) -> str:
    with kit.running(kit.middle) as harness:
        harness.stop(-1)
        harness.stop(-1)
        return _stops(harness, -1, "while it waits for the trigger")


@check("P11.4", "a stop at the end: the last `Log`, closing outputs, exit code 0", plain=True)
def _stop_at_end(kit: Kit) -> str:
    with kit.running(kit.steps) as harness:
        harness.await_logged()
        _stops(harness, kit.steps, "at the end")
        return _ended_complete(kit, harness, kit.steps)


def _ended_complete(kit: Kit, harness: Harness, end: int) -> str:
    """Check what was published and logged, closing outputs included."""
    transcript = harness.transcript
    closes = kit.spec.publishes == "first" and end % kit.spec.every == 0
    last = end if closes else end - 1 - (end - 1) % kit.spec.every
    if transcript.newest != last:
        clause = "P11.3" if closes else "P11.2"
        raise Failed(
            f"the last step it published is {transcript.newest}, expected {last} ({clause})"
        )
    if transcript.logged != transcript.packed:
        raise Failed(
            f"{len(transcript.packed)} Outputs were published, {len(transcript.logged)} logged"
        )
    return f"exit code 0, step {last} published and logged" + (" (closing)" if closes else "")


@check(
    "P11.2",
    "a stop that overtakes the last inputs: it finishes the step first",
    inputs=True,
    plain=True,
)
def _stop_overtakes(kit: Kit) -> str:
    last = kit.middle
    if not any(last in rows for rows in kit.feed.values()):
        raise Skipped("no source fires with it")
    with kit.running(last) as harness:
        harness.release(last + 1)
        harness.idle(_WAITING_S)
        harness.stop(last + 1)
        harness.stop(last + 1)
        harness.idle(_WAITING_S)
        harness.feed(kit.feed, last)
        _stops(harness, last + 1, f"at step {last + 1} that came before its inputs")
        return _ended_complete(kit, harness, last + 1)


@check("P4.4", "it exits with a non-zero code when the orchestrator disappears", plain=True)
def _orchestrator_gone(kit: Kit) -> str:
    with kit.running(kit.middle) as harness:
        harness.leave()
        code = harness.await_end("the orchestrator's disappearance", kit.spec.deadlines.stop_s)
        if code == 0:
            raise Failed("it exited with code 0, as if the run had finished")
        return f"ended by itself with code {code}"


@check("P11.4", "SIGTERM ends it within 1 s, with a non-zero exit code", plain=True)
def _sigterm(kit: Kit) -> str:
    with kit.running(kit.middle) as harness:
        harness.child.signal(signal.SIGTERM)
        code = harness.await_end("SIGTERM", _TERM_S)
        if code == 0:
            raise Failed("it exited with code 0 on SIGTERM")
        return f"it {harness.child.how_it_ended()}"
