"""`stepbus run --profile`: where the time of a step goes, without a change of the recording."""

import csv
import os
import sys
from pathlib import Path

import pytest

from stepbus_orchestrator.run.extensions.profile import Profile
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options
from stepbus_orchestrator.run.run_scenario import run as run_scenario
from stepbus_orchestrator.scenario.load import load
from stepbus_participant.session import profile
from stepbus_tools.run_lines import after_run

STEPBUS = str(Path(sys.executable).with_name("stepbus"))
STEPS = 40
PARTICIPANTS = ("controller", "mission", "plant")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return the results of two runs, the second one profiled."""
    folder = tmp_path_factory.mktemp("profile")
    scenario = load("two_link", [f"duration={STEPS * 5}ms"])
    plain = run_scenario(scenario, Options(out=folder / "plain", host=InProcess()))
    options = Options(out=folder / "profiled", host=InProcess(), extensions=[Profile()])
    return plain, run_scenario(scenario, options)


def rows_of(result, name):
    with (result.recording.parent / "profile" / f"{name}.csv").open(newline="") as file:
        return [{key: int(value) for key, value in row.items()} for row in csv.DictReader(file)]


def test_a_profile_does_not_change_the_recording(runs):
    plain, profiled = runs
    assert profiled.recording.read_bytes() == plain.recording.read_bytes()


@pytest.mark.parametrize("name", PARTICIPANTS)
def test_each_step_of_each_participant_has_a_row(runs, name):
    rows = rows_of(runs[1], name)
    assert [row["step"] for row in rows] == list(range(STEPS))
    assert all(row["compute_ns"] > 0 and row["transport_ns"] > 0 for row in rows)
    assert all(row["wait_ns"] >= 0 for row in rows)
    assert sum(row["record_ns"] for row in rows) > 0


def test_the_summary_has_each_participant_and_who_limits_the_run(runs):
    lines = after_run(runs[1].recording, has_plots=False)
    profiles = [line for line in lines if line.startswith("profile ")]
    assert sorted(line.split()[1].rstrip(":") for line in profiles) == list(PARTICIPANTS)
    assert any(line.startswith("limit ") for line in lines)


def test_a_folder_named_from_here_is_here_though_the_run_works_elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scenario = load("two_link", ["duration=100ms", "checkpoint=50ms"])
    options = Options(out=Path("here"), host=InProcess(), extensions=[Profile()])
    run_scenario(scenario, options)
    assert {"profile", "checkpoints", "run.mcap"} <= {path.name for path in Path("here").iterdir()}


def test_a_run_does_not_fail_from_a_profile_without_room(tmp_path, monkeypatch):
    monkeypatch.setattr(profile, "make_file", lambda _path: os.open("/dev/full", os.O_WRONLY))
    options = Options(out=tmp_path / "out", host=InProcess(), extensions=[Profile()])
    result = run_scenario(load("two_link", [f"duration={STEPS * 5}ms"]), options)
    assert (result.exit_code, result.steps) == (0, STEPS)
    log = (tmp_path / "out" / "logs" / "plant.log").read_text()
    assert log.count("plant.csv is incomplete: No space left") == 1


def test_the_summary_leaves_out_a_row_that_was_cut_off(runs):
    path = runs[1].recording.parent / "profile" / "plant.csv"
    whole, before = path.read_text(), after_run(runs[1].recording, has_plots=False)
    path.write_text(f"{whole}40,12")
    assert after_run(runs[1].recording, has_plots=False) == before
    path.write_text(whole)
