"""Two arms from one URDF in one world, each with a controller of its own."""

import pytest

from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load
from stepbus_tools.run_lines import after_run
from stepbus_tools.signals import read_tracking, tracking_rmse

JOINTS = ["left/joint1", "left/joint2", "right/joint1", "right/joint2"]


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pair")
    return run(load("two_link/pair"), Options(out=folder / "run", host=InProcess()))


def test_both_arms_follow_their_own_references(result):
    rmse = tracking_rmse(read_tracking(Recording(result.recording)))
    assert list(rmse) == JOINTS
    assert max(rmse.values()) < 0.001


def test_the_summary_and_the_plots_have_both(result):
    lines = after_run(result.recording, has_plots=True)
    assert all(name in lines[0] for name in JOINTS)
    assert lines[1].startswith("plots")


@pytest.mark.slow
def test_in_processes_of_their_own_the_recording_has_the_same_hash(tmp_path):
    scenario = load("two_link/pair", ["duration=100ms"])
    runs = [
        run(scenario, Options(out=tmp_path / str(n), host=host_of(in_process=bool(n))))
        for n in (0, 1)
    ]
    assert runs[0].sha256 == runs[1].sha256
