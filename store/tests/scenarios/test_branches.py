"""Scenarios of the store and Baxter, branched at random steps: each is the recording again."""

import random
from typing import ClassVar

import pytest
from support.runs.branches import unequal
from support.runs.patience import patient
from support.runs.store import NAMES, moves, store

from stepbus_orchestrator.recording.reader import Recording
from stepbus_orchestrator.replay.branch import branch
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("saves", [(), ("checkpoint=500ms",)])
@pytest.mark.parametrize("name", ["baxter", "baxter/round_trip"])
def test_a_branch_without_a_change_is_the_recording(name, saves, tmp_path):
    options = Options(out=tmp_path / "out", host=InProcess())
    recording = run(load(name, ["duration=2s", *saves]), options).recording
    assert unequal(recording, tmp_path, 5, name) == []


@pytest.fixture(scope="module")
def sale(tmp_path_factory):
    """A sale, with cameras, contacts and a planner."""
    return store(tmp_path_factory.mktemp("sale"), scenario="store").recording


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A sale in MuJoCo, with checkpoints of all participants."""
    overrides = ("plant.params.engine=mujoco", "checkpoint=192ms")
    return store(tmp_path_factory.mktemp("saved"), *overrides, scenario="store").recording


def grasp_in(recording):
    """Return a step in the middle of the grasp: the gripper closes, and does not hold yet."""
    gripper = Recording(recording)["plant.gripper"]
    return next(step for step, message in gripper.messages() if message.holding) - 5


class TestStore:
    """Branches of a sale."""

    pytestmark: ClassVar = [pytest.mark.slow, pytest.mark.timeout(1800)]

    def test_a_branch_without_a_change_is_the_recording(self, sale, tmp_path):
        assert unequal(sale, tmp_path, 2, "store", patient("store")) == []

    def test_a_sale_goes_on_from_the_middle_of_the_grasp(self, sale, tmp_path):
        at = grasp_in(sale)
        found = branch(sale, tmp_path / "b", at=at, set=patient("store"), in_process=True)
        assert found.equal
        assert moves(Recording(found.result.recording)) == moves(Recording(sale))

    def test_a_branch_of_a_sale_in_mujoco_starts_where_all_have_saved(self, saved, tmp_path):
        steps = [grasp_in(saved), *random.Random(50).sample(range(100, 900), 3)]
        for at in steps:
            found = branch(saved, tmp_path / f"{at}", at=at, set=patient("store"), in_process=True)
            assert found.equal, found.result.reason
            assert set(found.restored) == set(NAMES)
            late = {name for name, step in found.restored.items() if step < at - 12}
            # While it plans, the planner saves nothing.
            assert late <= {"planner"}

    def test_all_but_the_plant_save_a_sale_in_pybullet_too(self, tmp_path):
        overrides = ("checkpoint=192ms", "duration=1200ms")
        recording = store(tmp_path, *overrides, scenario="store").recording
        at = {"at": 60, "set": patient("store"), "in_process": True}
        found = branch(recording, tmp_path / "b", **at)
        assert found.equal, found.result.reason
        assert set(found.restored) == set(NAMES) - {"plant"}

    def test_the_states_of_two_runs_are_the_same_bytes(self, tmp_path):
        overrides = ("plant.params.engine=mujoco", "checkpoint=192ms", "duration=1200ms")
        runs = [
            store(tmp_path / name, *overrides, scenario="store", in_process=name == "a").recording
            for name in "ab"
        ]
        one, other = (
            {path.name: path.read_bytes() for path in (run.parent / "checkpoints").glob("*.[0-9]*")}
            for run in runs
        )
        assert one == other
