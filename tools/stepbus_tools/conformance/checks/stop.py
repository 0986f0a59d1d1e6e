"""Checks of the end: a stop at any time, closing outputs, the exit code."""

import signal

from stepbus_tools.conformance.check import check
from stepbus_tools.conformance.harness import Harness
from stepbus_tools.conformance.kit import Kit
from stepbus_tools.conformance.outcome import Failed, Skipped

_TERM_S = 1.0
# By then it waits: it has nothing else to do.
_WAITING_S = 0.1


def _stops(harness: Harness, at_step: int, when: str) -> str:
    """Stop it and check its exit code."""
    harness.stop(at_step)
    limit_s = harness.spec.deadlines.stop_s
    # Sent again, as the orchestrator does.
    code = harness.await_end(f"the Stop {when}", limit_s, lambda: harness.stop(at_step))
    faults = harness.transcript.faults
    if faults:
        raise Failed(f"a Stop {when} made it report a fault: {faults[0].message}")
    if code != 0:
        raise Failed(f"it {harness.how_it_ended()} after the Stop {when}{harness.last_error()}")
    return "exit code 0"


@check("P11.1", "a stop while it waits for its sources: exit code 0", inputs=True)
def stop_before_ready(kit: Kit) -> str:
    """Stop it while it still waits for its sources."""
    with kit.joined() as harness:
        limit_s = kit.spec.deadlines.ready_s
        harness.until(lambda: harness.transcript.handshakes, "a handshake", limit_s)
        return _stops(harness, -1, "before it was ready")


@check("P11.1", "a stop when it is ready: exit code 0")
def stop_before_start(kit: Kit) -> str:
    """Stop it when it is ready, before the Start."""
    with kit.ready() as harness:
        return _stops(harness, -1, "before the Start")


@check("P11.1", "a stop while it waits for inputs: exit code 0", inputs=True, plain=True)
def stop_while_waiting(kit: Kit) -> str:
    """Stop it while it waits for the inputs of a released step."""
    with kit.running(kit.middle) as harness:
        harness.release(kit.steps)
        harness.idle(_WAITING_S)
        return _stops(harness, -1, "while it waits for a source")


@check("P11.1", "a repeated stop while it waits for the trigger: exit code 0", plain=True)
def stop_between_steps(kit: Kit) -> str:
    """Stop it, more than once, while it waits for a trigger."""
    with kit.running(kit.middle) as harness:
        harness.stop(-1)
        harness.stop(-1)
        return _stops(harness, -1, "while it waits for the trigger")


@check("P11.4", "a stop at the end: the last `Log`, closing outputs, exit code 0", plain=True)
def stop_at_end(kit: Kit) -> str:
    """Stop it after its last step."""
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
        raise Failed(f"the last step it published is {transcript.newest}, due is {last} ({clause})")
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
def stop_overtakes(kit: Kit) -> str:
    """Let the Stop come before the inputs of the last step."""
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


@check("P4.4", "it exits with a code other than 0 when the orchestrator is lost", plain=True)
def orchestrator_gone(kit: Kit) -> str:
    """Leave the bus in the middle of the run, without a word."""
    with kit.running(kit.middle) as harness:
        harness.leave()
        code = harness.await_end("the orchestrator's disappearance", kit.spec.deadlines.stop_s)
        if code == 0:
            raise Failed("it exited with code 0, as if the run had ended well")
        return f"ended by itself with code {code}"


@check("P11.4", "SIGTERM ends it within 1 s, with a code other than 0", plain=True)
def sigterm(kit: Kit) -> str:
    """Send SIGTERM in the middle of the run."""
    with kit.running(kit.middle) as harness:
        harness.signal(signal.SIGTERM)
        code = harness.await_end("SIGTERM", _TERM_S)
        if code == 0:
            raise Failed("it exited with code 0 on SIGTERM")
        return f"it {harness.how_it_ended()}"
