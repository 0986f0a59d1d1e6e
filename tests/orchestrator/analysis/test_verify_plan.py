"""What `verify` changes from run to run."""

import pytest

from stepbus_orchestrator.analysis.verify import TRANSPORTS, WINDOWS, plan
from stepbus_orchestrator.scenario.load import load


@pytest.fixture(scope="module")
def scenario():
    return load("two_link", ["window=16", "batch=8"])


def test_five_runs_try_every_window_and_both_transports(scenario):
    trials = plan(scenario, 5, seed=0)[1:]
    assert sorted(trial.window for trial in trials) == sorted(WINDOWS)
    assert {trial.transport for trial in trials} == set(TRANSPORTS)


def test_the_last_run_has_all_participants_in_one_process(scenario):
    *others, last = plan(scenario, 4, seed=0, in_process=True)
    assert others == plan(scenario, 4, seed=0)
    assert (last.number, last.in_process, last.window) == (5, True, 16)


def test_a_scenario_that_needs_processes_is_run_in_separate_ones_only():
    scenario = load("two_link", ["controller.exec=[sleep, '1']"])
    assert not any(trial.in_process for trial in plan(scenario, 4, seed=0, in_process=True))
