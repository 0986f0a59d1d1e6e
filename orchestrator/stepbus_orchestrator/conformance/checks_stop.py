"""Checks of the end: a stop at any time, what is still published, the exit code."""

from __future__ import annotations

import signal

from .check import Check
from .kit import Kit
from .outcome import Failed, Skipped
from .stage import Stage

_TERM_S = 1.0
# By then it waits: it has nothing else to do.
_WAITING_S = 0.1


def _ends(stage: Stage, at_step: int, when: str) -> None:
    """Stop it and check its exit code."""
    stage.stop(at_step)
    limit_s = stage.spec.deadlines.stop_s
    # Said again, as the orchestrator does.
    code = stage.await_end(f"the Stop {when}", limit_s, lambda: stage.stop(at_step))
    if stage.seen.faults:
        raise Failed(f"a Stop {when} made it report a fault: {stage.seen.faults[0].message}")
    if code != 0:
        raise Failed(f"it {stage.how_it_ended()} after the Stop {when}{stage.last_error()}")


def stop_before_start(kit: Kit) -> str:
    """Stop it when it is ready, before the Start."""
    with kit.stage() as stage:
        stage.meet()
        _ends(stage, -1, "before the Start")
    return "exit code 0"


def stop_before_ready(kit: Kit) -> str:
    """Stop it while it still waits for its sources."""
    kit.need_inputs()
    with kit.stage() as stage:
        stage.open_bus()
        stage.start_program()
        stage.let_join()
        limit_s = kit.spec.deadlines.ready_s
        stage.until(lambda: stage.seen.handshakes, "a handshake", limit_s)
        _ends(stage, -1, "before it was ready")
    return "exit code 0"


def stop_while_waiting(kit: Kit) -> str:
    """Stop it while it waits for the inputs of a released step."""
    kit.need_inputs()
    kit.reference()
    with kit.stage() as stage:
        stage.meet()
        stage.start()
        stage.walk(kit.material.feed, 0, kit.middle)
        stage.release(kit.steps)
        stage.idle(_WAITING_S)
        _ends(stage, -1, "while it waits for a source")
    return "exit code 0"


def stop_between_steps(kit: Kit) -> str:
    """Stop it, more than once, while it waits for a trigger."""
    kit.reference()
    with kit.stage() as stage:
        stage.meet()
        stage.start()
        stage.walk(kit.material.feed, 0, kit.middle)
        stage.stop(-1)
        stage.stop(-1)
        _ends(stage, -1, "while it waits for the trigger")
    return "exit code 0"


def stop_at_end(kit: Kit) -> str:
    """Stop it after its last step."""
    kit.reference()
    with kit.stage() as stage:
        stage.meet()
        stage.start()
        stage.walk(kit.material.feed, 0, kit.steps)
        stage.await_logged()
        _ends(stage, kit.steps, "at the end")
        return _ended_whole(kit, stage, kit.steps)


def _ended_whole(kit: Kit, stage: Stage, end: int) -> str:
    """Check what was published and logged, closing outputs included."""
    seen = stage.seen
    closes = kit.spec.publishes == "first" and end % kit.spec.every == 0
    last = end if closes else end - 1 - (end - 1) % kit.spec.every
    if seen.newest != last:
        clause = "P11.3" if closes else "P11.2"
        raise Failed(f"the last step it published is {seen.newest}, due is {last} ({clause})")
    if seen.logged != seen.packed:
        raise Failed(f"{len(seen.packed)} Outputs were published, {len(seen.logged)} logged")
    return f"exit code 0, step {last} published and logged" + (" (closing)" if closes else "")


def stop_overtakes(kit: Kit) -> str:
    """Let the Stop come before the inputs of the last step."""
    kit.need_inputs()
    kit.reference()
    last = kit.middle
    if not any(last in rows for rows in kit.material.feed.values()):
        raise Skipped("no source fires with it")
    with kit.stage() as stage:
        stage.meet()
        stage.start()
        stage.walk(kit.material.feed, 0, last)
        stage.release(last + 1)
        stage.idle(_WAITING_S)
        stage.stop(last + 1)
        stage.stop(last + 1)
        stage.idle(_WAITING_S)
        stage.feed(kit.material.feed, last)
        _ends(stage, last + 1, f"at step {last + 1} that came before its inputs")
        return _ended_whole(kit, stage, last + 1)


def orchestrator_gone(kit: Kit) -> str:
    """Leave the bus in the middle of the run, without a word."""
    kit.reference()
    with kit.stage() as stage:
        stage.meet()
        stage.start()
        stage.walk(kit.material.feed, 0, kit.middle)
        stage.leave()
        code = stage.await_end("the orchestrator's disappearance", kit.spec.deadlines.stop_s)
        if code == 0:
            raise Failed("it exited with code 0, as if the run had ended well")
        return f"ended by itself with code {code}"


def sigterm(kit: Kit) -> str:
    """Send SIGTERM in the middle of the run."""
    kit.reference()
    with kit.stage() as stage:
        stage.meet()
        stage.start()
        stage.walk(kit.material.feed, 0, kit.middle)
        stage.signal(signal.SIGTERM)
        code = stage.await_end("SIGTERM", _TERM_S)
        if code == 0:
            raise Failed("it exited with code 0 on SIGTERM")
        return f"it {stage.how_it_ended()}"


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
        summary="a stop, said twice, while it waits for the trigger: exit code 0",
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
        summary="a stop that comes before the last inputs: the step is done first",
        run=stop_overtakes,
    ),
    Check(
        name="orchestrator-gone",
        clause="P4.4",
        summary="it ends by itself, with a code other than 0, when the orchestrator has gone",
        run=orchestrator_gone,
    ),
    Check(
        name="sigterm",
        clause="P11.4",
        summary="SIGTERM ends it within 1 s, with a code other than 0",
        run=sigterm,
    ),
)
