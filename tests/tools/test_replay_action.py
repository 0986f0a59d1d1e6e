"""The GitHub Action `action.yml`: its step runs here as it runs there."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from stepbus_orchestrator.recording import McapFile

ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "tests/scenarios/golden/two_link.mcap"
ACTION = yaml.safe_load((ROOT / "action.yml").read_text())
SHELL = shutil.which("bash") or "/bin/sh"
(STEP,) = (step for step in ACTION["runs"]["steps"] if step.get("id") == "replay")


def act(folder, **inputs):
    """Run the step in a folder as GitHub does; return its exit code, log, summary and outputs."""
    summary, outputs = folder / "summary.md", folder / "outputs"
    given = {name: one.get("default", "") for name, one in ACTION["inputs"].items()} | inputs
    values = {f"${{{{ inputs.{name} }}}}": value for name, value in given.items()}
    env = {
        name: values.get(value, value.replace("${{ runner.temp }}", str(folder / "temp")))
        for name, value in STEP["env"].items()
    }
    env |= {"GITHUB_STEP_SUMMARY": str(summary), "GITHUB_OUTPUT": str(outputs)}
    env |= {"GITHUB_ACTION_PATH": str(ROOT)}
    env["PATH"] = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    done = subprocess.run(
        [SHELL, "-e", "-c", STEP["run"]],
        cwd=folder,
        env=os.environ | env,
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    assert done.stderr == ""
    texts = [path.read_text() if path.exists() else "" for path in (summary, outputs)]
    return done.returncode, done.stdout, *texts


def test_each_value_of_the_step_is_an_input_or_a_path():
    assert all("${{" in value for value in STEP["env"].values())
    names = {value.split()[1] for value in STEP["env"].values()} - {"runner.temp"}
    assert names <= {f"inputs.{name}" for name in ACTION["inputs"]}


@pytest.mark.parametrize(
    ("inputs", "problem"),
    [
        ({"recordings": " \n"}, "name a recording or a pattern"),
        ({"recordings": "logs/*.mcap"}, "no file matches 'logs/*.mcap'"),
        ({"recordings": str(GOLDEN), "timeout": "soon"}, "'soon' is not a number of seconds"),
        ({"recordings": str(GOLDEN), "timeout": "nan"}, "'nan' is not a number of seconds"),
        ({"recordings": str(GOLDEN), "trust": "yes"}, "'yes' is neither true nor false"),
    ],
)
def test_a_wrong_input_is_one_error_in_log_and_summary(tmp_path, inputs, problem):
    code, log, summary, outputs = act(tmp_path, **inputs)
    assert (code, outputs) == (2, "")
    assert problem in summary
    assert problem in log
    assert log.startswith("::error title=stepbus replay::")
    assert log.count("\n") == 1


def test_equal_recordings_pass_and_leave_no_files(tmp_path):
    code, log, summary, outputs = act(tmp_path, recordings=str(GOLDEN), participants="controller")
    assert (code, outputs) == (0, "equal=true\n")
    assert log == f"{GOLDEN} controller: equal\n"
    assert "stepbus replay: all are equal" in summary
    assert [path for path in (tmp_path / "temp").rglob("*") if path.is_file()] == []


def test_a_folder_that_cannot_be_written_is_one_error(tmp_path):
    (tmp_path / "temp").write_text("a file")
    env = os.environ | {"RECORDINGS": str(GOLDEN), "PARTICIPANTS": "controller"}
    env |= {"OUT": str(tmp_path / "temp/out"), "PATH": f"{Path(sys.executable).parent}"}
    script = ROOT / "scripts/replay_recordings.py"
    done = subprocess.run(
        [sys.executable, script], env=env, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1
    assert done.stderr.startswith("stepbus replay: cannot write ")
    assert done.stderr.endswith(": Not a directory\n")


@pytest.mark.slow
def test_a_difference_is_in_summary_annotation_and_artifact(tmp_path):
    tool = Path(sys.executable).with_name("stepbus")

    def stepbus(*arguments):
        return subprocess.run(
            [tool, *arguments], cwd=tmp_path, check=True, capture_output=True, timeout=110
        )

    stepbus("new", "my_arm")
    stepbus("run", "my_arm", "--set", "duration=500ms", "--no-report", "--out", "runs/short")
    program = tmp_path / "my_arm/controller.py"
    text = program.read_text()
    assert "kp * error" in text
    program.write_text(text.replace("kp * error", "1.01 * kp * error"))
    (tmp_path / "runs/broken.mcap").write_text("no recording")
    recordings = "runs/short\nruns/*.mcap"
    code, log, summary, outputs = act(tmp_path, recordings=recordings, source="my_arm")
    assert (code, outputs) == (1, "equal=false\n")  # a replay that fails weighs more
    assert "runs/short plant: equal" in log
    assert "::error file=runs/short,title=stepbus replay::controller: step 1: " in log
    assert "::error file=runs/broken.mcap,title=stepbus replay::recording: stepbus: " in log
    assert "2 of 4 replays are not equal" in summary
    assert "| `runs/short` | controller | **different** | step 1: controller/command" in summary
    assert "controller.py" in summary.partition("changed since the recording")[2]
    (folder,) = (tmp_path / "temp/stepbus-replay").iterdir()
    assert f"`{folder.name}/report.html`" in summary
    page = (folder / "report.html").read_text()
    assert folder.name in page  # the replayed curves lie over those of the recording
    shown = ("--participant", "controller", "--source", "my_arm", "--json")
    again = stepbus("replay", folder / "new.mcap", *shown)
    assert json.loads(again.stdout)["equal"]


def test_a_participant_named_like_a_path_is_refused_and_no_file_is_touched(tmp_path):
    (tmp_path / "new.mcap").write_text("keep")
    code, log, _, _ = act(tmp_path, recordings=str(GOLDEN), participants="/../../..")
    assert (code, (tmp_path / "new.mcap").read_text()) == (2, "keep")
    assert "participants: '/../../..' is no name of a participant" in log
    assert not (tmp_path / "temp").exists()


def test_a_recorded_participant_named_like_a_path_is_refused_and_no_file_is_touched(tmp_path):
    (tmp_path / "new.mcap").write_text("keep")
    file = McapFile(tmp_path / "run.mcap")
    rows = "participants: {'/../../..': {exec: [python]}}"
    file.attach("scenario.yaml", rows.encode())
    file.close()
    code, log, summary, _ = act(tmp_path, recordings="run.mcap")
    assert (code, (tmp_path / "new.mcap").read_text()) == (1, "keep")
    assert "'/../../..' is not a valid name" in log
    assert "new.mcap" not in summary


def test_a_file_name_is_no_workflow_command_and_no_markdown(tmp_path):
    name = "a\n::warning::x, `b` <img> ##[group].mcap"
    (tmp_path / name).write_text("no recording")
    code, log, summary, _ = act(tmp_path, recordings="a*.mcap")
    assert code == 1
    assert log.count("\n") == 1
    shown = "a%0A%3A%3Awarning%3A%3Ax%2C `b` <img> ##[group].mcap"
    assert log.startswith(f"::error file={shown},title=stepbus replay::recording: ")
    assert r"a\\x0a::warning::x, \`b\` \<img\> ##\[group\].mcap" in summary
    (tmp_path / "::warning::x ##[group].mcap").write_bytes(GOLDEN.read_bytes())
    code, log, _, _ = act(tmp_path, recordings="::*.mcap", participants="controller")
    assert (code, log) == (0, ": :warning: :x ## [group].mcap controller: equal\n")
