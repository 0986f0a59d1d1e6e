"""Shipped scenarios, branched at random steps: without a change, each is the recording again."""

import pytest
from support.runs.branches import unequal

from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

TWO_LINK = ("pd", "pid", "pd_gravity", "velocity_force", "encoders", "tip", "pair")
NAMES = ("two_link", *(f"two_link/{name}" for name in TWO_LINK), "pick")


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", NAMES)
def test_a_branch_without_a_change_is_the_recording(name, tmp_path):
    options = Options(out=tmp_path / "out", host=InProcess())
    recording = run(load(name, ["duration=2s"]), options).recording
    assert unequal(recording, tmp_path, 5, name) == []
