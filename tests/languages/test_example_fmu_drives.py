"""The two-link arm with drives that are an FMU, built from C."""

import shutil
import subprocess
import sys

import numpy as np
import pytest
from support.paths import CHECKOUT
from support.tools import needs

import stepbus
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_tools.report.charts import find_signals

fmpy = pytest.importorskip("fmpy", reason="the extra `fmi` is not installed")

EXAMPLE = CHECKOUT / "examples/fmu_drives"
BUILT = shutil.ignore_patterns("drives.fmu", "drives.so")


def build(folder):
    """Return the FMU of a fresh copy of the example."""
    needs("make", "cc")
    shutil.copytree(EXAMPLE, folder, ignore=BUILT)
    subprocess.run(["make", "-s", "-C", folder, f"PYTHON={sys.executable}"], check=True)
    return folder / "drives.fmu"


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    return build(tmp_path_factory.mktemp("built") / "fmu_drives")


@pytest.fixture(scope="module")
def recording(fmu):
    """Return the recording of a second of the example, with a checkpoint every 0.2 s."""
    out = fmu.parent.parent / "run"
    assert run(fmu, out, "checkpoint=200ms") == 0
    return out / "run.mcap"


def run(fmu, out, *changes, more=()):
    """Run a second of the example; return the exit code."""
    sets = [word for text in ("duration=1s", *changes) for word in ("--set", text)]
    return main(["run", str(fmu.parent), *sets, *more, "--no-report", "--out", str(out)])


def errors(recording):
    """Return the root mean square of the errors of both joints [rad], without the start."""
    with Recording(recording) as opened:
        return np.sqrt((opened["controller.status"].error[100:] ** 2).mean(axis=0))


@pytest.fixture
def instance(fmu):
    """Return an instance of the FMU that is initialized, and its variables by name."""
    folder, description = fmpy.extract(fmu), fmpy.read_model_description(fmu)
    made = fmpy.instantiate_fmu(folder, description, "CoSimulation")
    made.setupExperiment(startTime=0.0)
    made.enterInitializationMode()
    made.exitInitializationMode()
    yield made, {item.name: item for item in description.modelVariables}
    made.terminate()
    made.freeInstance()
    shutil.rmtree(folder)


def test_the_same_source_gives_the_same_fmu_in_which_fmpy_finds_nothing_wrong(fmu, tmp_path):
    from fmpy.validation import validate_fmu  # noqa: PLC0415  (it takes long)

    assert build(tmp_path / "again").read_bytes() == fmu.read_bytes()
    assert validate_fmu(str(fmu)) == []


def test_the_description_has_the_start_values_of_the_program(instance):
    made, variables = instance
    said = {name: item.start for name, item in variables.items() if item.start is not None}
    got = made.getReal([variables[name].valueReference for name in said])
    assert dict(zip(said, got, strict=True)) == {name: float(text) for name, text in said.items()}


def test_its_torque_follows_the_command_and_its_state_has_no_pointers(instance):
    made, variables = instance
    torque, command = variables["tau[1]"].valueReference, variables["command[1]"].valueReference
    friction = variables["friction_torque[1]"].valueReference
    made.setReal([command, variables["velocity[1]"].valueReference], [8.0, 0.5])
    for step in range(200):
        made.doStep(step * 5e-3, 5e-3)
    # The joint turns at 0.5 rad/s: what does not reach it is friction.
    tau, lost = made.getReal([torque, friction])
    assert (tau + lost, lost) == (pytest.approx(8), pytest.approx(2 + 0.8 * 0.5, rel=0.01))
    state = np.frombuffer(made.serializeFMUstate(made.getFMUstate()))
    known = {*made.getReal([item.valueReference for item in variables.values()]), 1.0}
    assert set(state) == known


def test_a_parameter_that_makes_no_sense_is_refused_in_its_words(fmu, tmp_path, capsys):
    for change, words in {
        "gear[1].ratio=0": "drive 1: the parameter with the value 0 must be positive",
        "motor[2].inertia=1e-9": "drive 2: its rotor is too light, or its gear too stiff",
    }.items():
        assert run(fmu, tmp_path / words, f"drives.params.start.{change}") == ExitCode.START
        assert words in capsys.readouterr().err


def test_friction_makes_the_arm_lag(fmu, recording, tmp_path):
    assert run(fmu, tmp_path / "smooth", "drives.params.start.friction=0") == 0
    rough, smooth = errors(recording), errors(tmp_path / "smooth/run.mcap")
    assert np.all(rough > 4 * smooth)
    with Recording(recording) as opened:
        (chart,) = find_signals(opened, "drives.out.values[friction_torque[2]]")
        assert chart.lines[0].points[1][-1] == pytest.approx(-0.7, abs=0.1)


def test_it_runs_in_one_process_and_again_from_its_recording_alone(
    fmu, recording, tmp_path, capsys
):
    assert run(fmu, tmp_path / "one", "checkpoint=200ms", more=["--in-process"]) == 0
    assert (tmp_path / "one/run.mcap").read_bytes() == recording.read_bytes()
    alone = shutil.copy(recording, tmp_path / "alone.mcap")
    hidden = fmu.parent.rename(fmu.parent.with_name("hidden"))
    try:
        assert main(["rerun", str(alone), "--trust", "--out", str(tmp_path / "again")]) == 0
    finally:
        hidden.rename(fmu.parent)
    assert "byte for byte as recorded" in capsys.readouterr().out


def test_it_is_replayed_and_branched_from_its_state(recording, tmp_path, capsys):
    assert main(["replay", str(recording), "--participant", "drives", "--trust"]) == 0
    assert "drives: equal to the recording over 200 steps" in capsys.readouterr().out
    branch = ["branch", str(recording), "--at", "130", "--trust", "--no-report", "--out"]
    assert main([*branch, str(tmp_path / "same")]) == 0
    said = capsys.readouterr().out
    assert "drives from step 120" in said
    assert "200 steps, byte for byte as recorded" in said
    oiled = tmp_path / "oiled"
    assert main([*branch, str(oiled), "--call", "drives set friction 0.1"]) == 0
    with stepbus.Recording(oiled / "run.mcap") as after, stepbus.Recording(recording) as before:
        one, two = (opened["drives.out"]["values"] for opened in (before, after))
        assert np.array_equal(one[:130], two[:130])
        assert abs(two[-1, 1]) < 0.2 * abs(one[-1, 1])
