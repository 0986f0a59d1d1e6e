"""Files that users name, and that are named pipes, endless devices or larger than the memory."""

import os
import re
import shutil
from pathlib import Path

import pytest

import stepbus_scenarios
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options
from stepbus_orchestrator.run.run_scenario import run as run_scenario
from stepbus_orchestrator.scenario.load import load

SCENARIO = Path(stepbus_scenarios.__file__).parent / "two_link"
SINE = "amplitude: null, omega: null, phase: null"
CSV = f"""
extends: scenario.yaml
participants: {{mission: {{params: {{task: csv, file: path.csv, {SINE}}}}}}}
"""
TYPES = """
extends: scenario.yaml
types: own.yaml
"""


def pipe(path):
    os.mkfifo(path)


def endless(path):
    path.symlink_to("/dev/zero")


def huge(path):
    with path.open("wb") as file:
        file.truncate(2**41)


ODD = [pipe, endless, huge]


@pytest.fixture
def folder(tmp_path):
    """Return a folder with a copy of two_link, and scenarios that name further files."""
    copied = tmp_path / "scenario"
    shutil.copytree(SCENARIO, copied)
    (copied / "csv.yaml").write_text(CSV)
    (copied / "types.yaml").write_text(TYPES)
    return copied


def put(odd, path):
    path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    odd(path)


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize(
    ("scenario", "file"),
    [
        ("scenario.yaml", "scenario.yaml"),
        ("pd.yaml", "scenario.yaml"),
        ("scenario.yaml", "world.yaml"),
        ("scenario.yaml", "two_link.urdf"),
        ("types.yaml", "own.yaml"),
    ],
)
def test_a_file_of_a_scenario_is_refused_by_name(folder, capsys, odd, scenario, file):
    put(odd, folder / file)
    assert main(["validate", str(folder / scenario)]) == 2
    error = capsys.readouterr().err
    assert file in error
    assert "Traceback" not in error


@pytest.mark.parametrize("odd", ODD)
def test_a_file_that_a_participant_reads_ends_the_run_at_its_start(folder, tmp_path, capsys, odd):
    put(odd, folder / "path.csv")
    words = ["run", str(folder / "csv.yaml"), "--in-process", "--out", str(tmp_path / "out")]
    # What is a file, however large, is to be recorded first.
    assert main(words) == (8 if odd is huge else 3)
    error = capsys.readouterr().err
    assert re.search("cannot read .*path.csv as CSV: |path.csv cannot be read: ", error)
    assert "Traceback" not in error


@pytest.mark.slow
@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize(
    ("file", "words", "code"),
    [
        ("run.mcap", ["report", "{run}"], 8),
        ("run.mcap", ["recover", "{run}", "--in-place"], 8),
        ("result.json", ["report", "{run}"], 0),
        (".live.json", ["call", "{run}"], 2),
        ("checkpoints/index.json", ["branch", "{run}", "--at", "5", "--out", "{out}"], 0),
        ("tolerance.yaml", ["diff", "{run}", "{run}", "--tolerance", "{run}/tolerance.yaml"], 2),
        ("sweep.json", ["rerun", "{run}", "1"], 2),
        ("sweep.yaml", ["sweep", "{run}/sweep.yaml", "--out", "{out}"], 2),
    ],
)
def test_a_file_beside_a_recording_is_passed_over_or_refused(
    folder, tmp_path, capsys, odd, file, words, code
):
    run, out = tmp_path / "run", tmp_path / "out"
    scenario = load(folder / "scenario.yaml", ["duration=50ms"])
    assert run_scenario(scenario, Options(out=run, host=InProcess())).exit_code == 0
    put(odd, run / file)
    capsys.readouterr()
    assert main([word.format(run=run, out=out) for word in words]) == code
    assert "Traceback" not in capsys.readouterr().err
