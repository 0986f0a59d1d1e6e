"""The command line as a user meets it."""

import json
import re
import shlex
from pathlib import Path

import pytest

from stepbus_orchestrator.cli import COMMANDS, main, make_parser
from stepbus_orchestrator.errors import ExitCode

DOCS = Path(__file__).parent.parent / "docs"


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_every_example_of_every_command_can_be_parsed(command):
    assert command.examples
    for line in command.examples:
        make_parser().parse_args(shlex.split(line)[1:])


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_every_help_shows_its_examples(command, capsys):
    with pytest.raises(SystemExit):
        main([command.name, "--help"])
    said = capsys.readouterr().out
    assert all(example in said for example in command.examples)


def test_validate_shows_the_schedule(capsys):
    assert main(["validate", "two_link", "--steps", "2"]) == 0
    expected = "plant@0 mission@0 controller@0 plant@1 mission@1 controller@1 …"
    assert expected in capsys.readouterr().out


def test_a_scenario_with_five_mistakes_lists_all_and_starts_nothing(tmp_path, capsys):
    path = tmp_path / "scenario.yaml"
    path.write_text(
        "name: five\n"
        "step: 5 parsecs\n"
        "duration: 1s\n"
        "participants:\n"
        "  plant:\n"
        "    exec: [python, -m, no_such_module]\n"
        "    publishes: fist\n"
        "    inputs: {command: controler.command}\n"
        "    outputs: {joint_state: JointState/7}\n"
        "  controller:\n"
        "    exec: [python, -c, pass]\n"
        "    outputs: {command: JointCommand/1}\n"
    )
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == ExitCode.SCENARIO
    said = capsys.readouterr().err
    lines = {int(n) for n in re.findall(r"scenario\.yaml:(\d+): ", said)}
    assert {2, 6, 7, 8, 9} <= lines
    assert not (tmp_path / "out").exists()


def test_describe_names_joints_and_limits_without_a_step(capsys):
    assert main(["describe", "two_link", "--json"]) == 0
    ports = {row["port"]: row for row in json.loads(capsys.readouterr().out)}
    said = ports["joint_state"]["description"]
    assert said["names"] == ["joint1", "joint2"]
    assert said["limits"]["effort"] == [50, 50]
    assert ports["joint_state"]["taken_by"] == ["controller.joint_state"]


def test_describe_of_a_scenario_that_cannot_start_has_the_code_of_the_run(capsys):
    code = main(["describe", "two_link", "--set", "controller.params.law=no_such_law"])
    assert (code, "no_such_law" in capsys.readouterr().err) == (ExitCode.START, True)


def test_a_new_scenario_runs_as_it_is(tmp_path, capsys):
    folder = tmp_path / "mine"
    assert main(["new", str(folder)]) == 0
    run = ["run", str(folder), "--set", "duration=200ms", "--out", str(tmp_path / "out")]
    assert main(run) == 0
    assert "tracking RMSE" in capsys.readouterr().out
    assert (tmp_path / "out" / "report.png").stat().st_size > 10_000


def test_the_new_controller_has_at_most_15_lines(tmp_path):
    main(["new", str(tmp_path / "mine")])
    lines = (tmp_path / "mine" / "controller.py").read_text().splitlines()
    code = [line for line in lines if line.strip() and not line.startswith('"""')]
    assert len(code) <= 15


def test_new_refuses_a_folder_that_holds_something(tmp_path, capsys):
    (tmp_path / "mine.txt").touch()
    assert main(["new", str(tmp_path)]) == ExitCode.SCENARIO
    assert "holds something already" in capsys.readouterr().err


def test_doctor_passes_a_message_over_both_transports(capsys):
    assert main(["doctor", "--json"]) == 0
    findings = {row["what"]: row["verdict"] for row in json.loads(capsys.readouterr().out)}
    assert (findings["bus, unix"], findings["bus, tcp"]) == ("ok", "ok")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["run", "two_lonk"], "two_link"),
        (["run", "two_link", "--set", "controler.params.kp=1"], "controller"),
        (["run", "two_link", "--set", "nonsense"], "nonsense"),
        (["run", "two_link", "--out", "/proc/no/such"], "cannot make the folder"),
        (["validate", "/no/such/file.yaml"], "/no/such/file.yaml"),
        (["describe", "/dev/null"], "/dev/null"),
    ],
    ids=str,
)
def test_an_error_is_sentences_and_never_a_traceback(arguments, sentence, capsys):
    assert main(arguments) in {ExitCode.SCENARIO, ExitCode.RECORDING}
    said = capsys.readouterr().err
    assert sentence in said
    assert "Traceback" not in said


def test_the_page_of_exit_codes_has_every_code():
    rows = re.findall(r"^\| (\d+) \| (\w+) \|", (DOCS / "exit-codes.md").read_text(), re.MULTILINE)
    assert [(int(code), name) for code, name in rows] == [(int(c), c.name) for c in ExitCode]
