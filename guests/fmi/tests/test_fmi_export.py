"""`stepbus export-fmu`: what FMPy makes of the FMUs, beside the recordings of runs."""

import subprocess
import sys
from pathlib import Path

import fmu_importer
import numpy as np
import pytest
from fmu_importer import apart

import stepbus

STEPS = 100
SHARED = ("position", "velocity", "effort", "acceleration")
STATES = [f"joint_state.{field}[{i}]" for field in SHARED[:3] for i in (1, 2)]
WANTED = [f"reference.{field}[{i}]" for field in (*SHARED[:2], SHARED[3]) for i in (1, 2)]
VALUES = ["command.values[1]", "command.values[2]"]


def export(*words, cwd):
    command = [str(Path(sys.executable).with_name("stepbus")), "export-fmu", *words]
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, timeout=240, check=False
    )


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    out = tmp_path_factory.mktemp("run") / "run"
    assert not stepbus.run("two_link/pd", set=[f"duration={STEPS * 5}ms"], out=out).exit_code
    return stepbus.Recording(out)


@pytest.fixture(scope="module", params=["2", "3"])
def fmus(request, tmp_path_factory):
    """Return the folder of the FMUs of one version."""
    folder = tmp_path_factory.mktemp(f"fmi{request.param}")
    for name, words in {
        "controller": ["controller"],
        "all": [],
        "rest": ["--input", "controller"],
    }.items():
        done = export(
            "two_link/pd", *words, "--out", f"{name}.fmu", "--fmi", request.param, cwd=folder
        )
        assert not done.returncode, done.stderr
        assert f"{name}.fmu: FMI {request.param}.0" in done.stdout
    return folder


def inputs(recording):
    ports = {
        "joint_state": recording["plant.joint_state"],
        "reference": recording["mission.reference"],
    }
    return {
        name: getattr(ports[name.split(".")[0]], name.split(".")[1][:-3])[:STEPS, int(name[-2]) - 1]
        for name in (*STATES, *WANTED)
    }


@pytest.mark.parametrize("name", ["controller", "all", "rest"])
def test_fmpy_finds_the_fmu_valid(fmus, name):
    assert apart(fmu_importer.validated, fmus / f"{name}.fmu") == []


def test_a_controller_answers_recorded_inputs_as_it_did(fmus, recording):
    got = apart(fmu_importer.simulated, fmus / "controller.fmu", inputs(recording), VALUES)
    # FMPy's row of a time is what the step up to it has published.
    assert got[1:].tobytes() == recording["controller.command"].values[:STEPS].tobytes()


def test_a_whole_scenario_is_the_run(fmus, recording):
    names = ["plant.joint_state.position[1]", "plant.joint_state.position[2]"]
    got = apart(fmu_importer.simulated, fmus / "all.fmu", {}, names)
    wanted = recording["plant.joint_state"].position
    assert got[: len(wanted)].tobytes() == wanted.tobytes()


def test_a_controller_and_the_rest_are_the_run(fmus, recording):
    files = fmus / "controller.fmu", fmus / "rest.fmu"
    got = apart(fmu_importer.coupled, *files, STATES, WANTED, STEPS)
    assert np.array_equal(got, recording["plant.joint_state"].position[:STEPS])


def test_a_state_goes_on_in_another_instance(fmus, recording):
    file = fmus / "controller.fmu"
    went_on, restored = apart(fmu_importer.branched, file, inputs(recording), VALUES, 40)
    assert went_on == restored
    assert np.array_equal(went_on, recording["controller.command"].values[40:STEPS])


def test_variables_have_types_units_starts_and_descriptions(fmus):
    found = apart(fmu_importer.variables, fmus / "controller.fmu")
    real = "Float64" if fmus.name.startswith("fmi3") else "Real"
    text = "Proportional gain [N·m/rad]; for computed_torque [1/s²]."
    assert found["params.kp"] == ("parameter", real, "N·m/rad", "200.0", text)
    assert found["joint_state.position[2]"][:4] == ("input", real, "rad", "1.0")
    assert found["joint_state.position[2]"][4] == "measured positions, joint2"
    assert found["command.mode"][:2] == ("output", "String")
    assert found["status.saturated[1]"][:2] == ("output", "Boolean")
    everything = apart(fmu_importer.variables, fmus / "all.fmu")
    assert everything["mission.params.omega"][0] == "parameter"
    rest = apart(fmu_importer.variables, fmus / "rest.fmu")
    assert rest["controller.command.values[1]"][0] == "input"


def test_what_goes_wrong_is_in_the_log(fmus):
    file, nan = fmus / "controller.fmu", float("nan")
    lines, errors = apart(
        fmu_importer.failing, file, {}, [(0, 0.01), (3,), (0,)], {"joint_state.position[1]": nan}
    )
    assert "the FMU takes steps of 0.005 s from 0 on, not 0.01 s at 0 s" in lines
    assert "the next step of the FMU is 0, not 3, at 0.015 s" in lines
    assert "step 0: controller: step 0: the torques are {'joint1': nan" in lines[-1]
    assert len(errors) == 3
    assert errors[-1].endswith("(fatal)." if fmus.name.startswith("fmi2") else "(error).")


def test_a_parameter_is_checked_as_in_the_scenario(fmus):
    lines, errors = apart(
        fmu_importer.failing, fmus / "controller.fmu", {"params.kp": -1.0}, [], {}
    )
    assert "controller.params.kp: must be a number of at least 0" in lines[-1]
    assert len(errors) == 1


SLOW = """
import stepbus
class Half(stepbus.Participant):
    def update(self, step):
        new = step.is_new("signal")
        return {"out": stepbus.messages.Scalars(values=[float(step.index), float(new)])}
    def describe(self):
        return {"out": stepbus.Description(names=["index", "new"])}
"""
SCENARIO = """
name: slow
step: 5ms
duration: 1s
participants:
  source: {participant: 'half.py:Half', every: 4, inputs: {signal: half.out}, outputs: {out: Scalars/1}}
  half:
    participant: half.py:Half
    every: 2
    inputs: {signal: {from: source.out, delay: 1}}
    outputs: {out: Scalars/1}
"""


@pytest.mark.parametrize("version", ["2", "3"])
def test_every_and_new_messages_are_those_of_a_run(tmp_path, version):
    (tmp_path / "half.py").write_text(SLOW)
    (tmp_path / "scenario.yaml").write_text(SCENARIO)
    done = export("scenario.yaml", "half", "--out", "half.fmu", "--fmi", version, cwd=tmp_path)
    assert not done.returncode, done.stderr
    assert "left out: its state: its class does not save it" in done.stdout
    stepbus.run(tmp_path / "scenario.yaml", set=["duration=100ms"], out=tmp_path / "run")
    (tmp_path / "scenario.yaml").unlink()
    (tmp_path / "half.py").unlink()
    rows = {"signal.values[1]": np.zeros(20)}
    names = ["out.values[1]", "out.values[2]"]
    got = apart(fmu_importer.simulated, tmp_path / "half.fmu", rows, names)
    wanted = stepbus.Recording(tmp_path / "run")["half.out"].values
    assert np.array_equal(got[1::2], wanted)
    assert np.array_equal(got[2::2], wanted)


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["two_link", "controler", "--out", "a.fmu"], 2, "did you mean 'controller'?"),
        (["two_link", "controller", "--out", "a.zip"], 2, "the name of an FMU ends in .fmu"),
        (["two_link", "--out", "there.fmu"], 2, "there.fmu already exists"),
        (["two_link", "plant", "--input", "plant", "--out", "a.fmu"], 2, "--input is for a whole"),
        (["two_link", "--out", "a.fmu", "--fmi", "1"], 2, "--fmi"),
        (["two_link", "--out", "a.fmu", "--set", "controller.params.model=x.urdf"], 2, "x.urdf"),
        (["bad.yaml", "--out", "a.fmu"], 4, "no bytes today"),
        (["raw.yaml", "b", "--out", "a.fmu"], 2, "FMI has no variable for bytes"),
    ],
)
def test_bad_input_is_one_sentence(tmp_path, words, code, text):
    (tmp_path / "there.fmu").touch()
    (tmp_path / "raw.py").write_text(
        "import stepbus\nclass Raw(stepbus.Participant):\n    pass\n"
        "class Bad(Raw):\n    def start(self, inputs):\n        raise ValueError('no bytes today')\n"
    )
    for name, cls in {"bad": "Bad", "raw": "Raw"}.items():
        (tmp_path / f"{name}.yaml").write_text(
            f"name: {name}\nstep: 5ms\nduration: 1s\nparticipants:\n"
            f"  a: {{participant: 'raw.py:{cls}', outputs: {{data: Bytes/1}}}}\n"
            f"  b: {{participant: 'raw.py:{cls}', inputs: {{data: a.data}}}}\n"
        )
    done = export(*words, cwd=tmp_path)
    assert done.returncode == code, done.stderr
    assert text in done.stderr
    # What the participant itself has logged is quoted.
    assert ("Traceback" in done.stderr) == (code == 4)
    assert sorted(path.name for path in tmp_path.glob("a.*")) == []
