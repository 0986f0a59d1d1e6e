"""Checks of fatal inputs: the participant reports a fault, and blames the right one."""

from collections.abc import Callable, Set

import msgspec

from stepbus_schemas import Fault
from stepbus_tools.conformance.check import check
from stepbus_tools.conformance.feeds import Ports
from stepbus_tools.conformance.harness import Harness
from stepbus_tools.conformance.kit import Kit
from stepbus_tools.conformance.outcome import Failed, Skipped

Spoil = Callable[[Harness, str, int, Ports], None]
"""Publishes something wrong on behalf of a source, at a step where its outputs are due."""


def _faults(kit: Kit, spoil: Spoil) -> str:
    """Spoil one step of each source in turn; the participant has to report it."""
    return "; ".join(
        blames(kit, source, spoil, {i.port for i in kit.spec.inputs.values() if i.source == source})
        for source in kit.feed
    )


def blames(kit: Kit, source: str, spoil: Spoil, ports: Set[str]) -> str:
    """Spoil a step at which a source publishes one of some ports, which has to be reported."""
    at = _where(kit, source, ports)
    with kit.running(at) as harness:
        try:
            _walk_to_fault(kit, harness, source, at, spoil)
        except Failed:
            if not harness.transcript.faults:
                raise
        fault = harness.transcript.faults[0]
        _check_fault(harness, fault, source)
        return f"{source}: {fault.message[:100]}"


def _walk_to_fault(kit: Kit, harness: Harness, source: str, at: int, spoil: Spoil) -> None:
    # All peers continue, so that it meets what is wrong, however late it checks.
    harness.release(kit.steps)
    for step in range(at, kit.steps):
        for name, rows in kit.feed.items():
            if step not in rows:
                continue
            if name == source and step == at:
                spoil(harness, name, step, rows[step])
            else:
                harness.publish(name, step, rows[step])
    harness.until(
        lambda: (
            harness.transcript.faults or harness.transcript.newest >= kit.steps - kit.spec.every
        ),
        "a Fault",
        kit.spec.deadlines.step_s,
        harness.repeat,
        faults=True,
    )
    if not harness.transcript.faults:
        # One that publishes first may take in its last inputs only now.
        harness.idle(0.2)
    if not harness.transcript.faults:
        raise Failed(f"it did all {kit.steps} steps, and reported no fault of {source}")


def _where(kit: Kit, source: str, ports: Set[str]) -> int:
    """Return a step in the middle at which a source publishes what the participant reads."""
    steps = [step for step, row in kit.feed[source].items() if ports & row.keys()]
    if not steps:
        raise Skipped(f"{source} publishes nothing that it reads")
    return steps[len(steps) // 2]


def _check_fault(harness: Harness, fault: Fault, source: str) -> None:
    if fault.blames != source:
        raise Failed(f"its fault blames {fault.blames or 'nobody'}, not {source}: {fault.message}")
    harness.idle(0.05)
    if harness.transcript.logged != harness.transcript.packed:
        raise Failed(
            f"{len(harness.transcript.packed)} Outputs were published before the fault and "
            f"{len(harness.transcript.logged)} logged (P10.1)"
        )
    harness.stop(-1)
    # It may wait for the Stop, though not for long (P10.1).
    limit_s = harness.spec.deadlines.stop_s + 1.0
    code = harness.await_end("the Stop after its fault", limit_s, lambda: harness.stop(-1))
    if code == 0:
        raise Failed("it exited with code 0 after a fault (P10.1)")


@check(
    "P8.1",
    "a step repeated with other bytes is a fault that blames the source",
    inputs=True,
    plain=True,
)
def changed_duplicate(kit: Kit) -> str:
    """Publish a step twice, with other bytes."""

    def spoil(harness: Harness, source: str, step: int, ports: Ports) -> None:
        harness.publish(source, step, ports)
        harness.publish(source, step, {})

    return _faults(kit, spoil)


@check("P8.1", "so is a step that a source skips", inputs=True, plain=True)
def skipped_step(kit: Kit) -> str:
    """Leave out a step of a source."""
    return _faults(kit, lambda _stage, _source, _step, _ports: None)


@check("P8.1", "so is a malformed `Outputs` with the right token", inputs=True, plain=True)
def malformed_outputs(kit: Kit) -> str:
    """Publish what is no Outputs, but carries the token."""

    def spoil(harness: Harness, source: str, step: int, ports: Ports) -> None:
        bad = {"token": harness.token, "step": "seven", "t_ns": 0}
        harness.publish_bytes(source, msgspec.msgpack.encode(bad))
        harness.publish(source, step, ports)

    return _faults(kit, spoil)


@check("P8.2", "so is a due message that is not of its type", inputs=True, plain=True)
def wrong_message(kit: Kit) -> str:
    """Publish messages that are not of their port's type."""

    def spoil(harness: Harness, source: str, step: int, ports: Ports) -> None:
        # No field of any type may be an empty map.
        bad = {
            port: msgspec.msgpack.encode({key: {} for key in msgspec.msgpack.decode(data)})
            for port, data in ports.items()
        }
        harness.publish(source, step, bad)

    return _faults(kit, spoil)
