"""Faults as people write them."""

import pytest

from stepbus_orchestrator.errors import ScenarioError
from stepbus_orchestrator.scenario.fault_texts import FAULT_TYPES, format_fault
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.resolve import resolved


def texts(*faults, overrides=("duration=1s",)):
    return [format_fault(fault) for fault in load("two_link", overrides, faults).faults]


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("kill plant at 120", "kill plant at 120"),
        ("  freeze   controller at 10 for 0.2s", "freeze controller at 10 for 200ms"),
        ("delay mission at 8", "delay mission at 8 for 50ms"),
        ("slow plant at 0", "slow plant at 0 for 500ms"),
        ("freeze plant at 3", "freeze plant at 3"),
    ],
)
def test_a_fault_is_read_and_written_in_one_form(written, read):
    assert texts(written) == [read]
    assert texts(read) == [read]


@pytest.mark.parametrize(
    ("written", "sentence"),
    [
        ("kil plant at 3", "unknown fault type 'kil'; did you mean"),
        ("kill plnt at 3", "no participant 'plnt'; did you mean"),
        ("kill plant at 200", "step 200 is past the end of the run"),
        ("kill plant at 3 for 1s", "kill takes no duration; only delay"),
        ("delay plant at 3 for 5", "'5' is not a duration"),
        ("kill plant", "'kill plant': not a fault; write TYPE"),
        ("random 0", "must be 1 to 1000 faults, not 0"),
        ("random 3 from 7 to 7", "there are no steps from 7 to below 7"),
    ],
)
def test_a_fault_that_cannot_be_says_why(written, sentence):
    with pytest.raises(ScenarioError) as caught:
        texts(written)
    assert f"--fault {written}: faults[0]: {sentence}" in str(caught.value)


def test_a_message_fault_at_a_step_without_a_message_is_refused():
    with pytest.raises(ScenarioError, match="it fires every 4 steps; use 8 or 12"):
        texts("drop mission at 10", overrides=("duration=1s", "mission.every=4"))


def test_a_seed_draws_the_same_faults_of_every_kind_in_order_at_their_steps():
    drawn = texts("random 100 seed 7")
    assert drawn == texts("random 100 seed 7")
    assert drawn != texts("random 100 seed 8")
    assert {text.split()[0] for text in drawn} == set(FAULT_TYPES)
    steps = [int(text.split()[3]) for text in texts("random 100 from 20 to 30")]
    assert set(steps) <= set(range(20, 30))
    assert steps == sorted(steps)


def test_a_run_without_an_end_needs_the_last_step_of_random_faults():
    with pytest.raises(ScenarioError, match="needs a last step"):
        texts("random 3", overrides=("duration=null",))


def test_faults_of_the_scenario_come_first_and_are_part_of_what_determines_a_run():
    scenario = load("two_link", ["faults=[kill plant at 5]"], ["random 1 seed 3"])
    assert format_fault(scenario.faults[0]) == "kill plant at 5"
    assert all(f'- "{format_fault(fault)}"\n' in resolved(scenario) for fault in scenario.faults)


def test_faults_of_the_scenario_that_are_no_list_are_the_only_problem():
    with pytest.raises(ScenarioError) as info:
        texts("kill plant at 3", overrides=("duration=1s", "faults=kill plant at 2"))
    assert [problem.path for problem in info.value.problems] == ["faults"]


def test_without_faults_in_the_scenario_those_of_the_command_line_are_all():
    assert texts("kill plant at 3", overrides=("duration=1s", "faults=null")) == ["kill plant at 3"]
    assert texts(overrides=("duration=1s", "faults=[kill plant at 2]")) == ["kill plant at 2"]


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("plant.on_fault=hold", "hold is not possible for a participant that publishes first"),
        ("controller.on_fault=halt", "must be stop, hold or a map, not 'halt'"),
        ("controller.on_fault={hald: 1s}", "did you mean 'hold'?"),
        ("controller.on_fault={safe: {comand: {}}}", "did you mean 'command'?"),
        (
            "controller.on_fault={safe: {command: {mode: jump, values: []}}}",
            "is not a valid JointCommand/1",
        ),
    ],
)
def test_who_cannot_be_held_is_refused(setting, sentence):
    with pytest.raises(ScenarioError) as caught:
        load("two_link", [setting])
    assert sentence in str(caught.value)


def test_holding_is_part_of_what_determines_a_run():
    text = resolved(load("two_link", ["controller.on_fault={hold: 1s, keep: 0s}"]))
    assert "on_fault: {hold: 1s, keep: 0s}" in text
