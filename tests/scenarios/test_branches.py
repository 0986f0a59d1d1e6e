"""Shipped scenarios, branched at random steps: without a change, each is the recording again."""

import random
from typing import ClassVar

import pytest
from support.runs.store import NAMES as STORE
from support.runs.store import moves, slow_with_robots, store

from stepbus_orchestrator import Options, Recording, load
from stepbus_orchestrator.replay.branch import branch
from stepbus_orchestrator.run.run_scenario import run

TWO_LINK = ("pd", "pid", "pd_gravity", "velocity_force", "encoders", "tip", "pair")
NAMES = ("two_link", *(f"two_link/{name}" for name in TWO_LINK), "baxter", "baxter/round_trip")


def unequal(recording, folder, count, key, overrides=()):
    """Return the steps of some random ones at which a branch is not the recording."""
    last = Recording(recording).last_step
    steps = random.Random(f"15/{key}").sample(range(last + 1), count)
    return [
        (step, found.result.reason)
        for step in steps
        if not (
            found := branch(recording, step, folder / str(step), overrides, in_process=True)
        ).equal
    ]


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", NAMES)
def test_a_branch_without_a_change_is_the_recording(name, tmp_path):
    options = Options(out=tmp_path / "out", in_process=True)
    recording = run(load(name, ["duration=2s"]), options).recording
    assert unequal(recording, tmp_path, 5, name) == []


PATIENT = [f"{name}.step_timeout=120s" for name in STORE]
"""A busy machine is nobody's fault here."""


@pytest.fixture(scope="module")
def sale(tmp_path_factory):
    """A sale, with cameras, contacts and a planner."""
    return store(tmp_path_factory.mktemp("sale"), *PATIENT, scenario="store").recording


@pytest.fixture(scope="module")
def grasp(sale):
    """The step in the middle of the grasp: the gripper closes, and does not hold yet."""
    gripper = Recording(sale)["plant.gripper"]
    held = next(step for step, message in gripper.messages() if message.holding)
    return held - 5


class TestStore:
    """Branches of a sale."""

    pytestmark: ClassVar = [*slow_with_robots, pytest.mark.timeout(1800)]

    def test_a_branch_without_a_change_is_the_recording(self, sale, tmp_path):
        assert unequal(sale, tmp_path, 2, "store", PATIENT) == []

    def test_a_sale_goes_on_from_the_middle_of_the_grasp(self, sale, grasp, tmp_path):
        found = branch(sale, grasp, tmp_path / "b", PATIENT, in_process=True)
        assert found.equal
        assert moves(Recording(found.result.recording)) == moves(Recording(sale))
