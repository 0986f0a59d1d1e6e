"""Checks of the end: a stop at any time, closing outputs, the exit code."""

from __future__ import annotations

import signal

from stepbus_orchestrator.conformance.check import Check
from stepbus_orchestrator.conformance.harness.harness import Harness
from stepbus_orchestrator.conformance.harness.kit import Kit
from stepbus_orchestrator.conformance.outcome import Failed, Skipped

_TERM_S = 1.0
# By then it waits: it has nothing else to do.
_WAITING_S = 0.1


def _ends(harness: Harness, at_step: int, when: str) -> None:
    """Stop it and check its exit code."""
    harness.stop(at_step)
    limit_s = harness.spec.deadlines.stop_s
    # Sent again, as the orchestrator does.
    code = harness.await_end(f"the Stop {when}", limit_s, lambda: harness.stop(at_step))
    if harness.transcript.faults:
        raise Failed(
            f"a Stop {when} made it report a fault: {harness.transcript.faults[0].message}"
        )
    if code != 0:
        raise Failed(f"it {harness.how_it_ended()} after the Stop {when}{harness.last_error()}")


def stop_before_start(kit: Kit) -> str:
    """Stop it when it is ready, before the Start."""
    with kit.harness() as harness:
        harness.meet()
        _ends(harness, -1, "before the Start")
    return "exit code 0"


def stop_before_ready(kit: Kit) -> str:
    """Stop it while it still waits for its sources."""
    kit.need_inputs()
    with kit.harness() as harness:
        harness.open_bus()
        harness.start_program()
        harness.await_join()
        limit_s = kit.spec.deadlines.ready_s
        harness.until(lambda: harness.transcript.handshakes, "a handshake", limit_s)
        _ends(harness, -1, "before it was ready")
    return "exit code 0"


def stop_while_waiting(kit: Kit) -> str:
    """Stop it while it waits for the inputs of a released step."""
    kit.need_inputs()
    kit.reference()
    with kit.harness() as harness:
        harness.meet()
        harness.start()
        harness.walk(kit.material.feed, 0, kit.middle)
        harness.release(kit.steps)
        harness.idle(_WAITING_S)
        _ends(harness, -1, "while it waits for a source")
    return "exit code 0"


def stop_between_steps(kit: Kit) -> str:
    """Stop it, more than once, while it waits for a trigger."""
    kit.reference()
    with kit.harness() as harness:
        harness.meet()
        harness.start()
        harness.walk(kit.material.feed, 0, kit.middle)
        harness.stop(-1)
        harness.stop(-1)
        _ends(harness, -1, "while it waits for the trigger")
    return "exit code 0"


def stop_at_end(kit: Kit) -> str:
    """Stop it after its last step."""
    kit.reference()
    with kit.harness() as harness:
        harness.meet()
        harness.start()
        harness.walk(kit.material.feed, 0, kit.steps)
        harness.await_logged()
        _ends(harness, kit.steps, "at the end")
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


def stop_overtakes(kit: Kit) -> str:
    """Let the Stop come before the inputs of the last step."""
    kit.need_inputs()
    kit.reference()
    last = kit.middle
    if not any(last in rows for rows in kit.material.feed.values()):
        raise Skipped("no source fires with it")
    with kit.harness() as harness:
        harness.meet()
        harness.start()
        harness.walk(kit.material.feed, 0, last)
        harness.release(last + 1)
        harness.idle(_WAITING_S)
        harness.stop(last + 1)
        harness.stop(last + 1)
        harness.idle(_WAITING_S)
        harness.feed(kit.material.feed, last)
        _ends(harness, last + 1, f"at step {last + 1} that came before its inputs")
        return _ended_complete(kit, harness, last + 1)


def orchestrator_gone(kit: Kit) -> str:
    """Leave the bus in the middle of the run, without a word."""
    kit.reference()
    with kit.harness() as harness:
        harness.meet()
        harness.start()
        harness.walk(kit.material.feed, 0, kit.middle)
        harness.leave()
        code = harness.await_end("the orchestrator's disappearance", kit.spec.deadlines.stop_s)
        if code == 0:
            raise Failed("it exited with code 0, as if the run had ended well")
        return f"ended by itself with code {code}"


def sigterm(kit: Kit) -> str:
    """Send SIGTERM in the middle of the run."""
    kit.reference()
    with kit.harness() as harness:
        harness.meet()
        harness.start()
        harness.walk(kit.material.feed, 0, kit.middle)
        harness.signal(signal.SIGTERM)
        code = harness.await_end("SIGTERM", _TERM_S)
        if code == 0:
            raise Failed("it exited with code 0 on SIGTERM")
        return f"it {harness.how_it_ended()}"


CHECKS = (
    Check(
        name="stop-before-ready",
        clause="P11.1",
        summary="a stop while it waits for its sources: exit code 0",
        run=stop_before_ready,
    ),
    Check(
        name="stop-before-start",
        clause="P11.1",
        summary="a stop when it is ready: exit code 0",
        run=stop_before_start,
    ),
    Check(
        name="stop-while-waiting",
        clause="P11.1",
        summary="a stop while it waits for inputs: exit code 0",
        run=stop_while_waiting,
    ),
    Check(
        name="stop-between-steps",
        clause="P11.1",
        summary="a repeated stop while it waits for the trigger: exit code 0",
        run=stop_between_steps,
    ),
    Check(
        name="stop-at-end",
        clause="P11.4",
        summary="a stop at the end: the last `Log`, closing outputs, exit code 0",
        run=stop_at_end,
    ),
    Check(
        name="stop-overtakes",
        clause="P11.2",
        summary="a stop that overtakes the last inputs: it finishes the step first",
        run=stop_overtakes,
    ),
    Check(
        name="orchestrator-gone",
        clause="P4.4",
        summary="it exits with a code other than 0 when the orchestrator is lost",
        run=orchestrator_gone,
    ),
    Check(
        name="sigterm",
        clause="P11.4",
        summary="SIGTERM ends it within 1 s, with a code other than 0",
        run=sigterm,
    ),
)
