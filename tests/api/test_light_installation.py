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


@pytest.mark.parametrize(("module", "who"), [("pybullet", "plant"), ("pinocchio", "controller")])
def test_a_participant_without_its_extra_is_one_sentence(without, tmp_path, module, who):
    without(module)
    code, text = stepbus("run", "two_link", "--out", str(tmp_path / "run"))
    assert code != 0
    (line,) = (line for line in text.splitlines() if line.startswith("stepbus: "))
    assert who in line
    assert module in line
    assert f"No module named {module!r}{extra_hint(module)}" in line


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
    assert f"no plots  matplotlib is not installed{extra_hint('matplotlib')}" in text


def test_what_needs_no_extra_works_without_any(without):
    without("coal", "cv2", "matplotlib", "ompl", "pinocchio", "pybullet", "ruckig", "toppra")
    assert stepbus("--help")[0] == 0
    assert stepbus("validate", "two_link")[0] == 0
    assert stepbus("conformance", "--list")[0] == 0
