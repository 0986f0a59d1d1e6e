"""Scenarios of the store and Baxter, branched at random steps: each is the recording again."""

from typing import ClassVar

import pytest
from support.runs.branches import unequal
from support.runs.patience import patient
from support.runs.store import moves, store

from stepbus_orchestrator.recording.reader import Recording
from stepbus_orchestrator.replay.branch import branch
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", ["baxter", "baxter/round_trip"])
def test_a_branch_without_a_change_is_the_recording(name, tmp_path):
    options = Options(out=tmp_path / "out", host=InProcess())
    recording = run(load(name, ["duration=2s"]), options).recording
    assert unequal(recording, tmp_path, 5, name) == []


@pytest.fixture(scope="module")
def sale(tmp_path_factory):
    """A sale, with cameras, contacts and a planner."""
    return store(tmp_path_factory.mktemp("sale"), scenario="store").recording


@pytest.fixture(scope="module")
def grasp(sale):
    """The step in the middle of the grasp: the gripper closes, and does not hold yet."""
    gripper = Recording(sale)["plant.gripper"]
    held = next(step for step, message in gripper.messages() if message.holding)
    return held - 5


class TestStore:
    """Branches of a sale."""

    pytestmark: ClassVar = [pytest.mark.slow, pytest.mark.timeout(1800)]

    def test_a_branch_without_a_change_is_the_recording(self, sale, tmp_path):
        assert unequal(sale, tmp_path, 2, "store", patient("store")) == []

    def test_a_sale_goes_on_from_the_middle_of_the_grasp(self, sale, grasp, tmp_path):
        found = branch(sale, tmp_path / "b", at=grasp, set=patient("store"), in_process=True)
        assert found.equal
        assert moves(Recording(found.result.recording)) == moves(Recording(sale))
