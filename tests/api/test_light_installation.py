"""What happens where only the light installation is: no physics, no dynamics, no plots."""

import os
import subprocess
import sys

import pytest

import stepbus
from stepbus_participant import extra_hint

BLOCKER = """
from importlib.machinery import PathFinder

found = PathFinder.find_spec
PathFinder.find_spec = lambda name, *rest: None if name in {names!r} else found(name, *rest)
"""


@pytest.fixture
def without(tmp_path, monkeypatch):
    """Return a function that hides modules from every Python process that is started."""

    def hide(*names):
        (tmp_path / "site").mkdir()
        (tmp_path / "site" / "sitecustomize.py").write_text(BLOCKER.format(names=names))
        monkeypatch.setenv("PYTHONPATH", str(tmp_path / "site"))

    return hide


def stepbus_command(*words):
    """Return what a command prints, both streams, and its exit code."""
    done = subprocess.run(
        [sys.executable, "-m", "stepbus_orchestrator.cli", *words],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ,
    )
    return done.returncode, done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ("validate",),
        ("run", "--out", "run"),
        *(pytest.param(words, marks=pytest.mark.slow) for words in [("describe",), ("verify",)]),
    ],
)
@pytest.mark.parametrize(
    ("module", "who"), [("pybullet or mujoco", "plant"), ("pinocchio", "controller")]
)
def test_a_participant_without_its_extra_is_one_sentence_before_the_start(
    without, tmp_path, monkeypatch, module, who, words
):
    without(*module.split(" or "))
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setenv("TMPDIR", str(folder))
    command, *options = words
    code, text = stepbus_command(command, "two_link", *options)
    assert code == 2
    (line,) = (line for line in text.splitlines() if f"stepbus_{who}" in line)
    sentence = f"stepbus_{who} needs {module}, which is not installed{extra_hint(module)}"
    assert line.endswith(sentence)
    assert f"participants.{who}" in line
    assert list(folder.iterdir()) == []


def test_every_participant_that_lacks_its_extra_is_named(without):
    without("mujoco", "pinocchio", "pybullet")
    text = stepbus_command("validate", "two_link")[1]
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
    code, text = stepbus_command(*words)
    assert code == 0
    assert f"matplotlib, which is not installed{extra_hint('matplotlib')}" in text


def test_what_needs_no_extra_works_without_any(without):
    without(
        "coal", "cv2", "matplotlib", "mujoco", "ompl", "pinocchio", "pybullet", "ruckig", "toppra"
    )
    assert stepbus_command("--help")[0] == 0
    assert stepbus_command("conformance", "--list")[0] == 0


RUN = (
    *("cyclopts", "greenlet", "isal", "mcap", "msgpack", "numpy", "rich", "ruamel", "trustme"),
    "zstandard",
)
"""What only the orchestrator needs."""
LIGHT = """
import sys

import stepbus

class Light(stepbus.Participant):
    def update(self, step):
        return {"state": stepbus.JointState(position=[0.1 * step.index])}

code = stepbus.main(Light)
assert not set(sys.modules) & RUN, set(sys.modules) & RUN
sys.exit(code)
"""
LIGHT_SCENARIO = """
name: light
step: 10ms
duration: 100ms
participants:
  light:
    exec: [env, PYTHONPATH=site, {python}, light.py]
    outputs: {{state: JointState/1}}
"""


def test_a_participant_needs_nothing_that_only_the_orchestrator_needs(
    without, tmp_path, monkeypatch
):
    without(*RUN)
    monkeypatch.delenv("PYTHONPATH")
    (tmp_path / "light.py").write_text(f"RUN = {set(RUN)!r}\n{LIGHT}")
    (tmp_path / "light.yaml").write_text(LIGHT_SCENARIO.format(python=sys.executable))
    result = stepbus.run(tmp_path / "light.yaml", out=tmp_path / "run")
    assert result.exit_code == 0, result.reason
    assert len(list(stepbus.Recording(result.recording)["light.state"].messages())) == 10


def test_a_command_line_without_its_extra_is_one_sentence(without):
    without(*RUN)
    code, text = stepbus_command("run", "two_link")
    assert code == 2
    (line,) = text.splitlines()
    assert line.startswith("stepbus: the command line needs ")
    assert line.endswith(f", which is not installed{extra_hint('mcap')}")


def test_a_name_of_an_extra_says_how_to_get_it(without):
    without(*RUN)
    code = "import stepbus\ntry: stepbus.run\nexcept stepbus.WiringError as exc: print(exc)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("stepbus.run needs ")
    assert done.stdout.endswith(f"which is not installed{extra_hint('numpy')}\n")
