"""`stepbus export-fmu`: what FMPy makes of the FMUs, beside the recordings of runs."""

import fmu_importer as importer
import numpy as np
import pytest
from fmu_importer import STEPS
from stepbus_fmi.declared import ExportFmu
from stepbus_fmi.export.work import exportfmu_command

import stepbus

COMMAND = ExportFmu.complete()
STATE = ("position", "velocity", "effort")
GOAL = ("position", "velocity", "acceleration")
VALUES = ["command.values[1]", "command.values[2]"]
HALF = """
import stepbus
from stepbus_schemas.messages import BytesMessage
class Half(stepbus.Participant):
    def update(self, step):
        new = step.is_new("signal")
        if step.index == 90:
            step.end("that is all")
        return {"out": stepbus.messages.Scalars(values=[float(step.index), float(new)])}
    def describe(self):
        return {"out": stepbus.Description(names=["index", "new"])}
class Raw(stepbus.Participant):
    def update(self, step):
        return {port: BytesMessage(data=b"raw") for port in self.config.outputs}
class Bad(Raw):
    def start(self, inputs):
        raise ValueError("no bytes today")
"""
HALF_SCENARIO = """
name: half
step: 5ms
duration: 100ms
participants:
  source: {participant: 'half.py:Half', every: 4, inputs: {signal: half.out}, outputs: {out: Scalars/1}}
  half:
    participant: half.py:Half
    every: 2
    inputs: {signal: {from: source.out, delay: 1}}
    outputs: {out: Scalars/1}
"""


def export(scenario, out, *participant, **given):
    return "\n".join(exportfmu_command(COMMAND(scenario, *participant, out=out, **given)).lines)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a scenario, and the runs `pd` and `half`."""
    folder = tmp_path_factory.mktemp("runs")
    (folder / "half.py").write_text(HALF)
    (folder / "scenario.yaml").write_text(HALF_SCENARIO)
    assert not stepbus.run(folder / "scenario.yaml", out=folder / "half").exit_code
    duration = [f"duration={STEPS * 5}ms"]
    assert not stepbus.run("two_link/pd", set=duration, out=folder / "pd").exit_code
    return folder


@pytest.fixture(scope="module")
def recording(folder):
    return stepbus.Recording(folder / "pd")


@pytest.fixture(scope="module", params=["2", "3"])
def got(request, recording, folder, tmp_path_factory):
    """Return what FMPy makes of the FMUs of one version, by name."""
    fmus, fmi = tmp_path_factory.mktemp("fmus"), request.param
    controller, whole, rest, half = (fmus / f"{name}.fmu" for name in ("a", "b", "c", "d"))
    text = export("two_link/pd", controller, "controller", fmi=fmi)
    assert f"a.fmu: FMI {fmi}.0, 2" in text
    assert "left out: controller.status.warnings: a list of any length" in text
    export("two_link/pd", again := fmus / "again/a.fmu", "controller", fmi=fmi)
    assert again.read_bytes() == controller.read_bytes()
    export("two_link/pd", whole, fmi=fmi)
    export("two_link/pd", rest, fmi=fmi, input="controller")
    export(folder / "scenario.yaml", half, "half", fmi=fmi)
    inputs = {
        f"{port}.{field}[{i}]": getattr(recording[f"{owner}.{port}"], field)[:STEPS, i - 1]
        for owner, port, fields in (("plant", "joint_state", STATE), ("mission", "reference", GOAL))
        for field in fields
        for i in (1, 2)
    }
    states, goals = list(inputs)[:6], list(inputs)[6:]
    positions = ["plant.joint_state.position[1]", "plant.joint_state.position[2]"]
    zero, outs = {"signal.values[1]": np.zeros(20)}, ["out.values[1]", "out.values[2]"]
    failing = importer.failing
    calls = {
        "problems": (importer.problems, [controller, whole, rest, half]),
        "controller": (importer.simulated, controller, inputs, VALUES),
        "whole": (importer.simulated, whole, {}, positions),
        "coupled": (importer.coupled, controller, rest, states, goals),
        "half": (importer.simulated, half, zero, outs),
        "variables": (importer.variables, [controller, whole, rest]),
        "long step": (failing, controller, {}, [(0, 0.01)], {}),
        "later step": (failing, controller, {}, [(0,), (3,)], {}),
        "nan": (failing, controller, {}, [(0,)], {"joint_state.position[1]": float("nan")}),
        "parameter": (failing, controller, {"params.kp": -1.0}, [], {}),
        "end": (failing, half, {}, [(index,) for index in range(92)], {}),
    }
    return importer.apart(calls) | {"version": fmi}


def test_fmpy_finds_the_fmus_valid(got):
    assert got["problems"] == []


def test_the_results_are_those_of_the_runs_bit_for_bit(got, recording, folder):
    # FMPy's row of a time is what the step up to it has published.
    command = recording["controller.command"].values[:STEPS]
    assert got["controller"][1:].tobytes() == command.tobytes()
    position = recording["plant.joint_state"].position
    assert got["whole"][: len(position)].tobytes() == position.tobytes()
    assert np.array_equal(got["coupled"], position[:STEPS])
    # It works at every second step; its messages are new as in the run.
    half = stepbus.Recording(folder / "half")["half.out"].values
    assert np.array_equal(got["half"][1::2], half)
    assert np.array_equal(got["half"][2::2], half)


def test_variables_have_types_units_starts_and_descriptions(got):
    found, everything, rest = got["variables"]
    real = "Float64" if got["version"] == "3" else "Real"
    text = "Proportional gain [N·m/rad]; for computed_torque [1/s²]."
    assert found["params.kp"] == ("parameter", real, "N·m/rad", "200.0", text)
    assert found["joint_state.position[2]"][:4] == ("input", real, "rad", "1.0")
    assert found["joint_state.position[2]"][4] == "measured positions, joint2"
    assert found["command.mode"][:2] == ("output", "String")
    assert found["status.saturated[1]"][:2] == ("output", "Boolean")
    assert everything["mission.params.omega"][0] == "parameter"
    assert rest["controller.command.values[1]"][0] == "input"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("long step", "the next step of the FMU is of 0.005 s at 0 s, not 0.01 s at 0 s"),
        ("later step", "the next step of the FMU is of 0.005 s at 0.005 s, not 0.005 s at 0.015 s"),
        ("nan", "step 0: the torques are {'joint1': nan"),
        ("parameter", "controller.params.kp: must be a number of at least 0"),
    ],
)
def test_what_goes_wrong_is_in_the_log(got, name, text):
    lines, error = got[name]
    assert text in "".join(lines)
    assert "(fatal)" in error


def test_a_participant_ends_the_simulation(got):
    lines, end = got["end"]
    assert "half: that is all" in "".join(lines)
    assert ("(discard)" if got["version"] == "2" else "terminateSimulation") in end


@pytest.mark.parametrize(
    ("scenario", "words", "given", "text"),
    [
        ("two_link", ["controler"], {}, "did you mean 'controller'?"),
        ("two_link", ["controller"], {"out": "a.zip"}, "the name of an FMU ends in .fmu"),
        ("two_link", [], {"out": "there.fmu"}, "there.fmu already exists"),
        ("two_link", ["plant"], {"input": "plant"}, "--input is for a whole scenario"),
        ("two_link", ["mission"], {"out": "there.fmu/a.fmu"}, "there.fmu/a.fmu cannot be written"),
        ("Bad", [], {}, "no bytes today"),
        ("Raw", ["b"], {}, "FMI has no variable for bytes"),
    ],
)
def test_bad_input_is_one_sentence(tmp_path, scenario, words, given, text):
    (tmp_path / "there.fmu").touch()
    (tmp_path / "half.py").write_text(HALF)
    rows = f"  a: {{participant: 'half.py:{scenario}', outputs: {{data: Bytes/1}}}}\n"
    rows += f"  b: {{participant: 'half.py:{scenario}', inputs: {{data: a.data}}}}\n"
    own = tmp_path / "scenario.yaml"
    own.write_text(f"name: own\nstep: 5ms\nduration: 1s\nparticipants:\n{rows}")
    given = {**given, "out": tmp_path / given.get("out", "a.fmu")}
    with pytest.raises(stepbus.StepbusError) as caught:
        export(scenario if scenario == "two_link" else own, given.pop("out"), *words, **given)
    assert text in str(caught.value)
    assert not list(tmp_path.glob("a.*"))
