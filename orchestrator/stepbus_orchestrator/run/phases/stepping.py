"""Stepping: step after step is released until the run has ended (P5)."""

from stepbus_orchestrator.run.kernel.deadlines import check_step
from stepbus_orchestrator.run.kernel.phase import RunPhase
from stepbus_orchestrator.run.loop.loop import RunLoop


def step(loop: RunLoop) -> RunPhase:
    """Release step after step until the last one is complete."""
    state = loop.state
    barrier = state.barrier
    loop.release(always=True)
    while not state.is_complete:
        before = barrier.count
        loop.turn(lambda elapsed_s: _check(loop, elapsed_s))
        if barrier.count == before:
            # A participant may have missed it: it was published before the link was complete.
            loop.announcer.repeat(with_start=not barrier.has_all_started)
    return RunPhase.CLOSING


def _check(loop: RunLoop, elapsed_s: float) -> None:
    loop.release(always=True)
    # Nobody is late while a gate holds the run.
    if not loop.state.is_held:
        check_step(loop.state, elapsed_s)
