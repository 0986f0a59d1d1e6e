"""A feature of a run is a file of its own that the run does not know."""

import re

import pytest
from support.paths import CHECKOUT
from support.runs.joints import run_joints

from stepbus import Recording
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.extension import RunExtension

PAGE = (CHECKOUT / "docs/guide/writing/extension.md").read_text()
"""Each of them is an extension; `paused` is what a run may be, whoever holds it."""


class EndsAt(RunExtension):
    def __init__(self, step):
        self._step = step

    def completed(self, step):
        if step == self._step:
            self.run.end("enough")


class Breaks(RunExtension):
    def completed(self, step):
        if step == 6:
            raise ValueError("broken")


class Counts(RunExtension):
    def __init__(self):
        self.called = []

    def completed(self, step):
        newest = self.run.newest("plant.joint_state")
        self.called.append((step, newest.position[0]))


@pytest.mark.parametrize("options", [(), ("window=3", "batch=1"), ("window=32",)])
def test_the_step_that_it_ends_the_run_behind_depends_on_no_window(tmp_path, options):
    result = run_joints(tmp_path, "duration=1s", *options, extensions=[EndsAt(7)])
    assert (result.steps, result.reason, result.exit_code) == (8, "enough", 0)


def test_it_sees_each_step_with_its_messages(tmp_path):
    counts = Counts()
    result = run_joints(tmp_path, "duration=100ms", extensions=[counts], in_process=True)
    recorded = [
        message.position[0] for _, message in Recording(result)["plant.joint_state"].messages()
    ]
    assert counts.called == list(enumerate(recorded[: result.steps]))


def test_what_it_raises_ends_the_run_with_a_sentence_and_a_whole_recording(tmp_path):
    result = run_joints(tmp_path, "duration=1s", extensions=[Breaks()])
    assert result.exit_code == ExitCode.INTERNAL
    assert "Breaks, in completed: ValueError" in result.reason
    assert len(Recording(result)["plant.joint_state"]) >= 7


def test_the_extension_of_the_page_ends_a_run(tmp_path, capsys):
    file = tmp_path / "limit.py"
    file.write_text(re.search(r"<!-- limit.py -->\n```python\n(.*?)```", PAGE, re.DOTALL).group(1))
    out = tmp_path / "out"
    words = ["run", "two_link", "--with", f"{file}:Limit", "--no-report", "--in-process"]
    assert main([*words, "--out", str(out)]) == 0
    assert "joint1 is at 0.503 rad" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("{}:No", "No is not a stepbus.RunExtension"),
        ("{}:Asks", "cannot be created: TypeError"),
        ("{}:Nobody", "has no class 'Nobody'"),
        ("missing.py:Limit", "no file 'missing.py'"),
        ("{}", "is not of the form"),
        ("no_such_module:Limit", "module 'no_such_module'"),
    ],
)
def test_a_mistake_in_its_name_is_told_before_the_run(tmp_path, capsys, name, sentence):
    file = tmp_path / "mine.py"
    file.write_text(
        "import stepbus\nclass No: pass\nclass Asks(stepbus.RunExtension):\n"
        "    def __init__(self, limit): pass\n"
    )
    command = ["run", "two_link", "--with", name.format(file), "--out", str(tmp_path / "out")]
    assert main(command) == 2
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
