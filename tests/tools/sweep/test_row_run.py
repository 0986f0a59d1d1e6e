"""A run of a sweep that was made elsewhere starts only when its user says so."""

import shutil

import pytest
from support.runs.joints import write_scenario

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.recorded import recorded_end
from stepbus_orchestrator.scenario.load import load
from stepbus_tools.sweep.bundle import collect
from stepbus_tools.sweep.rows import Journal, ResultRow
from stepbus_tools.sweep.spec import Spec, save_spec


@pytest.fixture
def swept(tmp_path, monkeypatch):
    """Return the scenario of a sweep in the current folder, and what makes the sweep's folder."""
    monkeypatch.chdir(tmp_path)
    scenario = write_scenario(tmp_path / "mine")

    def make(**values):
        folder = tmp_path / "swept"
        collect([load(scenario, ["duration=50ms"])], []).unpack(folder / "source")
        save_spec(folder, Spec(scenario="mine"), "")
        with Journal(folder) as journal:
            journal.add(ResultRow(run=0, values=values, outcome="finished", exit_code=0))
        return folder

    return scenario, make


def test_a_strangers_sweep_names_its_programs_and_starts_none(swept, tmp_path, capsys):
    scenario, make = swept
    folder = make()
    shutil.rmtree(scenario.parent)
    assert main(["rerun", str(folder), "0"]) == ExitCode.UNTRUSTED
    said = capsys.readouterr().err
    assert f"{folder / 'sweep.json'} contains programs that are not those of your scenario." in said
    assert "\n  controller  joints.py:Controller\n" in said
    assert "\n  its files: joints.py\n" in said
    assert not (tmp_path / "runs").exists()


def test_a_value_of_a_strangers_run_is_no_way_to_a_program(swept, capsys):
    _, make = swept
    folder = make(**{"controller.participant": "colorsys:rgb_to_hsv"})
    assert main(["rerun", str(folder), "0"]) == ExitCode.UNTRUSTED
    assert "\n  controller  colorsys:rgb_to_hsv\n" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("is_trusted", [False, True])
def test_a_sweep_of_the_work_tree_or_with_trust_is_run(swept, tmp_path, monkeypatch, is_trusted):
    scenario, make = swept
    folder, out = make(), tmp_path / "again"
    if is_trusted:
        shutil.rmtree(scenario.parent)
    else:
        monkeypatch.chdir(scenario.parent)
    main(["rerun", str(folder), "0", "--out", str(out), *["--trust"] * is_trusted])
    assert recorded_end(Recording(out / "run.mcap")) == 10
