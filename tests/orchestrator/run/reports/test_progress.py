"""How far a run says that it is."""

from types import SimpleNamespace

import pytest

from stepbus_orchestrator.run.reports import progress_of


@pytest.mark.parametrize(
    ("steps", "total", "phase"),
    [(5, 9, "paused"), (5, None, "paused"), (9, 9, "stepping")],
)
def test_a_run_whose_steps_are_all_done_is_not_paused(steps, total, phase):
    state = SimpleNamespace(
        phase=SimpleNamespace(is_stepping=True, shown="stepping"),
        is_held=True,
        steps=steps,
        scenario=SimpleNamespace(steps=total, step_ns=1, participants={}),
        participants={},
        compute={},
        barrier=SimpleNamespace(holders=list),
        newest={},
    )
    descriptions = SimpleNamespace()
    assert progress_of(state, descriptions, 1.0, is_held=True).phase == phase
