"""Closing: the stop is announced, closing outputs come in, the recording is finished (P11)."""

import time

from stepbus_orchestrator.run.kernel.deadlines import check_bulk, check_closing
from stepbus_orchestrator.run.kernel.phase import RunPhase
from stepbus_orchestrator.run.loop.loop import RunLoop
from stepbus_orchestrator.scenario import Schedule


def close(loop: RunLoop) -> RunPhase:
    """Ask for the closing outputs (P11.3), and finish the recording behind them."""
    state = loop.state
    end = state.last_step
    schedule = Schedule.of(state.scenario)
    closing = [name for name in schedule.order if schedule.closing(name, end)]
    peers = loop.strategy.peers
    peers.close(end, [name for name in closing if name in peers.names], state.barrier.reported)
    loop.stop(state.reason, at_step=end)
    _await_outputs(loop, closing)
    _await_bulk(loop)
    loop.is_recorded = True
    loop.recorder.finish(end, closing)
    return RunPhase.SHUTDOWN


def _await_outputs(loop: RunLoop, closing: list[str]) -> None:
    state = loop.state
    while any(state.barrier.reported[name] < state.last_step for name in closing):
        loop.turn(lambda elapsed_s: check_closing(state, closing, elapsed_s))


def _await_bulk(loop: RunLoop) -> None:
    began = time.monotonic()
    while not loop.recorder.bulk_complete():
        loop.turn(lambda _elapsed_s: check_bulk(loop.state, time.monotonic() - began))
