"""How far a run may go: the barrier, and every gate (P5.2, P5.5)."""

from support.runs.kernel import scenario

from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.kernel.barrier import FAR, Barrier, step_limit


def before(step):
    """Return a gate before a step."""
    return lambda _released: step


def test_without_gates_the_barrier_decides():
    assert step_limit(Barrier(scenario(window=3)), [], 0) == 3


def test_the_nearest_gate_decides():
    assert step_limit(Barrier(scenario(steps=100)), [before(9), before(FAR), before(4)], 0) == 4


def test_what_has_been_released_is_never_taken_back():
    assert step_limit(Barrier(scenario(steps=100)), [before(4)], 7) == 7


def test_a_pause_holds_what_is_not_released():
    pace = Pace()
    pace.pause()
    assert step_limit(Barrier(scenario(steps=100)), [pace.limit], 7) == 7
