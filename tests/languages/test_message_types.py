"""Message types of one's own, from one YAML file, in Python and C."""

import shutil
import subprocess

import pytest
from support.paths import CHECKOUT
from support.tools import needs

import stepbus
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

EXAMPLE = CHECKOUT / "examples/thruster"
SHORT = ["duration=1s"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a copy of the example, with its controller built."""
    needs("make", "cc")
    copy = tmp_path_factory.mktemp("thruster") / "thruster"
    shutil.copytree(EXAMPLE, copy, ignore=shutil.ignore_patterns("controller", "__pycache__"))
    subprocess.run(["make", "-s", "-C", copy], check=True)
    return copy


@pytest.fixture(scope="module")
def result(folder):
    """Return the result of a second of the example."""
    return run(load(folder, SHORT), Options(out=folder.parent / "out"))


def test_a_type_of_ones_own_goes_through_python_and_c_and_is_recorded(result):
    assert (result.exit_code, result.steps) == (0, 50)
    with stepbus.Recording(result.recording) as recording:
        thruster, depth = recording["controller.thruster"], recording["vehicle.depth"]
        assert thruster.thrust.shape == (50, 2)
        assert (list(thruster.names), set(thruster.mode)) == (["left", "right"], {"on"})
        assert depth.depth[-1] > 0.5
        assert recording.types == stepbus.messages.load_types(EXAMPLE / "types.yaml")


@pytest.mark.parametrize("participant", ["vehicle", "controller"])
def test_it_is_replayed(result, participant, capsys):
    arguments = ["replay", str(result.recording), "--participant", participant, "--trust"]
    assert main(arguments) == 0
    assert f"{participant}: equal to the recording over 50 steps" in capsys.readouterr().out


def test_it_runs_again_from_its_recording_and_compares_equal(result, tmp_path, capsys):
    again = tmp_path / "again"
    assert main(["rerun", str(result.recording), "--trust", "--out", str(again)]) == 0
    assert "byte for byte as recorded" in capsys.readouterr().out
    assert main(["diff", str(result.recording), str(again)]) == 0


def refused(folder, changes):
    """Return why a run is refused in a copy of the example with changed files."""
    for name, (old, new) in changes.items():
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new))
    result = run(load(folder, SHORT), Options(out=folder / "out"))
    assert result.exit_code == ExitCode.START
    return result.reason


def test_a_program_that_knows_another_version_is_refused(folder, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "copy")
    shutil.copy(copy / "types.yaml", copy / "old.yaml")
    old = (copy / "old.yaml").read_text()
    (copy / "old.yaml").write_text(old.replace("Thruster/1", "Thruster/2"))
    text = {"vehicle.py": ('TYPES["Thruster/1"]', 'TYPES["Thruster/2"]')}
    (copy / "vehicle.py").write_text(
        (copy / "vehicle.py").read_text().replace("types.yaml", "old.yaml")
    )
    assert "the program has Thruster/2" in refused(copy, text)


def test_a_program_that_knows_other_fields_under_the_same_version_is_refused(folder, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "copy")
    shutil.copy(copy / "types.yaml", copy / "old.yaml")
    changes = {"types.yaml": ("unit: N", "unit: kN"), "vehicle.py": ("types.yaml", "old.yaml")}
    assert refused(copy, changes).endswith("raise the version of the changed type")


def test_a_program_in_c_that_insists_on_another_version_is_refused_before_the_run(folder, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "copy")
    text = (copy / "scenario.yaml").read_text()
    (copy / "scenario.yaml").write_text(text.replace("type: Depth/1", "type: Depth/2"))
    with pytest.raises(stepbus.ScenarioError) as caught:
        load(copy)
    first = str(caught.value).splitlines()[0]
    assert first.startswith("scenario.yaml:17: ")
    assert first.endswith("'Depth/2'; did you mean 'Depth/1'?")


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_conformance_kit_plays_it(folder, monkeypatch, capsys):
    # From the checkout, a replay would find examples/thruster, which may not be built.
    monkeypatch.chdir(folder.parent)
    for participant, failures in (("controller", 0), ("vehicle", 0)):
        arguments = ["conformance", "--scenario", str(folder), "--participant", participant]
        assert main(arguments) == 0
        assert f", {failures} failed," in capsys.readouterr().out
