"""The command line as a user meets it."""

import shlex
import subprocess
import sys
from importlib.metadata import version

import pytest
from support.runs.joints import write_scenario

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.cli.app import command_names, examples_of, load_command
from stepbus_orchestrator.cli.dispatch import parsed
from stepbus_orchestrator.errors import ExitCode


@pytest.mark.parametrize("name", command_names())
def test_every_example_of_every_command_can_be_parsed(name):
    examples = examples_of(load_command(name))
    assert examples
    for line in examples:
        parsed(*shlex.split(line)[1:])


def test_the_version_is_that_of_the_package(capsys):
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0
    assert capsys.readouterr().out == f"stepbus {version('stepbus')}\n"


def test_validate_shows_the_schedule(capsys):
    assert main(["validate", "two_link", "--steps", "2"]) == 0
    expected = "plant@0 mission@0 controller@0 plant@1 mission@1 controller@1 …"
    assert expected in capsys.readouterr().out


def test_a_scenario_with_mistakes_lists_all_and_starts_nothing(tmp_path, capsys):
    words = ["run", "two_link", "--set", "step=5", "--set", "plant.publishes=fist"]
    assert main([*words, "--out", str(tmp_path / "out")]) == ExitCode.SCENARIO
    assert len(capsys.readouterr().err.splitlines()) == 2
    assert not (tmp_path / "out").exists()


def test_a_new_scenario_runs_as_it_is(tmp_path, capsys):
    folder = tmp_path / "mine"
    assert main(["new", str(folder)]) == 0
    words = ["run", str(folder), "--in-process", "--set", "duration=200ms"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    assert "tracking RMSE" in capsys.readouterr().out
    assert (tmp_path / "out" / "report.png").stat().st_size > 10_000


def test_a_current_folder_that_is_gone_is_a_sentence(tmp_path, capsys, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert main(["validate", "my.yaml"]) == ExitCode.INTERNAL
    assert "stepbus: the current folder: No such" in capsys.readouterr().err


@pytest.mark.parametrize(
    "closed",
    [
        pytest.param("<&-", marks=pytest.mark.slow),
        pytest.param(">&-", marks=pytest.mark.slow),
        pytest.param("2>&-", marks=pytest.mark.slow),
        "<&- >&- 2>&-",
    ],
)
def test_closed_standard_streams_are_no_mistake(tmp_path, closed):
    path = write_scenario(tmp_path / "source")
    words = [sys.executable, "-m", "stepbus_orchestrator.cli", "run", str(path), "--no-report"]
    line = f"{shlex.join([*words, '--out', str(tmp_path / 'out')])} {closed}"
    done = subprocess.run(["sh", "-c", line], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_dropped_messages_are_counted_in_words(tmp_path, capsys):
    path = write_scenario(tmp_path / "source")
    words = ["run", str(path), "--in-process", "--no-report", "--out", str(tmp_path / "out")]
    assert main([*words, "--fault", "duplicate controller at 5"]) == 0
    assert "1 by plant; unauthenticated: 0" in capsys.readouterr().out


@pytest.mark.parametrize("options", [[], ["--wait", "10min"]])
def test_a_program_to_join_with_may_follow_options(options: list[str]) -> None:
    program = ["python", "-m", "pdb", "my.py", "--wait"]
    found = parsed("join", "c.ticket", *options, "--", *program)
    assert found.program == tuple(program)
    assert str(found.ticket) == "c.ticket"
