"""Where a run writes: a folder of its own, also for runs that start in the same second."""

import contextlib
import subprocess
import sys

import pytest

import stepbus
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import RecordingFailed, StartFailed
from stepbus_orchestrator.run.folder import default_folder
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load


def test_every_default_folder_is_a_new_one(tmp_path):
    scenario = load("two_link")
    folders = {default_folder(scenario, tmp_path / "runs") for _ in range(5)}
    assert len(folders) == 5


def test_a_default_folder_that_cannot_be_made_is_reported(tmp_path):
    (tmp_path / "runs").write_text("a file")
    with pytest.raises(RecordingFailed, match="cannot create a folder in"):
        default_folder(load("two_link"), tmp_path / "runs")


@pytest.mark.slow
def test_runs_that_start_together_do_not_share_a_folder(tmp_path):
    words = ["run", "two_link", "--in-process", "--no-report", "--json", "--set", "duration=50ms"]
    runs = [
        subprocess.Popen(
            [sys.executable, "-m", "stepbus_orchestrator.cli", *words],
            cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )
        for _ in range(3)
    ]  # fmt: skip
    assert [process.wait(60) for process in runs] == [0, 0, 0]
    assert len(list((tmp_path / "runs").iterdir())) == 3


@pytest.fixture
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def no_engine(monkeypatch):
    for package in ("pybullet", "mujoco"):
        monkeypatch.setitem(sys.modules, package, None)


@pytest.mark.usefixtures("no_engine")
@pytest.mark.parametrize(
    "start",
    [
        lambda: main(["run", "two_link", "--debug", "nobody"]),
        lambda: main(["run", "two_link", "--no-report"]),
        lambda: main(["run", "two_link", "--no-report", "--view"]),
        lambda: stepbus.run("two_link"),
        lambda: stepbus.run("two_link", external={"nobody": "ticket"}),
    ],
)
def test_a_run_that_cannot_start_leaves_no_default_folder(start, empty_folder, monkeypatch):
    viewed = "stepbus_orchestrator.cli.run_command.viewed"
    monkeypatch.setattr(viewed, lambda *_, **__: contextlib.nullcontext())
    with contextlib.suppress(stepbus.StepbusError):
        assert start() == 2
    assert list(empty_folder.iterdir()) == []


def test_a_shell_that_allows_too_few_files_leaves_no_default_folder(empty_folder, monkeypatch):
    monkeypatch.setattr("resource.getrlimit", lambda _kind: (30, 30))
    with pytest.raises(StartFailed, match="ulimit -n"):
        run(load("two_link"), Options())
    assert list(empty_folder.iterdir()) == []
