"""What happens where only the light installation is: no physics, no dynamics, no plots."""

import os
import subprocess
import sys

import pytest

from stepbus_participant import extra_hint

BLOCKER = """
import sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name in {names!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Blocker())
"""


@pytest.fixture
def without(tmp_path, monkeypatch):
    """Return a function that hides modules from every Python process that is started."""

    def hide(*names):
        (tmp_path / "site").mkdir()
        (tmp_path / "site" / "sitecustomize.py").write_text(BLOCKER.format(names=names))
        monkeypatch.setenv("PYTHONPATH", str(tmp_path / "site"))

    return hide


def stepbus(*words):
    """Return what a command prints, both streams, and its exit code."""
    done = subprocess.run(
        [sys.executable, "-m", "stepbus_orchestrator.cli", *words],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ,
    )
    return done.returncode, done.stdout + done.stderr


@pytest.mark.parametrize(
    "words",
    [
        ("validate",),
        ("run", "--out", "run"),
        *(pytest.param(words, marks=pytest.mark.slow) for words in [("describe",), ("verify",)]),
    ],
)
@pytest.mark.parametrize(("module", "who"), [("pybullet", "plant"), ("pinocchio", "controller")])
def test_a_participant_without_its_extra_is_one_sentence_before_the_start(
    without, tmp_path, monkeypatch, module, who, words
):
    without(module)
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setenv("TMPDIR", str(folder))
    command, *options = words
    code, text = stepbus(command, "two_link", *options)
    assert code == 2
    (line,) = (line for line in text.splitlines() if f"stepbus_{who}" in line)
    sentence = f"stepbus_{who} needs {module}, which is not installed{extra_hint(module)}"
    assert line.endswith(sentence)
    assert f"participants.{who}" in line
    assert list(folder.iterdir()) == []


def test_every_participant_that_lacks_its_extra_is_named(without):
    without("pinocchio", "pybullet")
    text = stepbus("validate", "two_link")[1]
    assert [who for who in ("controller", "mission", "plant") if f"stepbus_{who} needs" in text] == [
        "controller", "plant",
    ]  # fmt: skip


def test_a_run_without_matplotlib_says_how_to_get_the_plots(without, tmp_path):
    without("matplotlib")
    words = (
        "run",
        "two_link",
        "--in-process",
        "--set",
        "duration=100ms",
        "--out",
        str(tmp_path / "run"),
    )
    code, text = stepbus(*words)
    assert code == 0
    assert (
        f"no plots  a plot needs matplotlib, which is not installed{extra_hint('matplotlib')}"
        in text
    )


def test_what_needs_no_extra_works_without_any(without):
    without("coal", "cv2", "matplotlib", "ompl", "pinocchio", "pybullet", "ruckig", "toppra")
    assert stepbus("--help")[0] == 0
    assert stepbus("conformance", "--list")[0] == 0
