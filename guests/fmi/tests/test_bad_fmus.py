"""FMUs that are wrong, fail, hang or crash: one sentence, an exit code, nothing lost or left."""

import json
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import bad_c
import fmus
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader
from stepbus_fmi.instance import Instance
from stepbus_fmi.model import read_model
from stepbus_fmi.params import Params
from support.surroundings import comes_true, processes_in

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode
from stepbus_schemas import WiringError

PATIENT = dict.fromkeys(("spawn_timeout", "ready_timeout", "step_timeout", "stop_timeout"), "60s")


class Bench:
    """Runs scenarios of one FMU `model.fmu` in a folder, and says what is left of them."""

    def __init__(self, folder, temp, capfd):
        self.folder, self.temp, self._capfd = folder, temp, capfd
        self.out = folder / "out"

    def write(self, row=(), **scenario):
        """Write a scenario; row: keys of its participant `m`."""
        m = {"participant": "model.fmu", **PATIENT, **dict(row)}
        data = {
            "name": "x", "step": "10ms", "duration": "100ms", "batch": 1,
            **scenario,
            "participants": {"m": m, **scenario.get("participants", {})},
        }  # fmt: skip
        path = self.folder / "x.yaml"
        path.write_text(json.dumps(data))
        return str(path)

    def run(self, code, *words, row=(), in_process=True, **scenario):
        """Run to an end with an exit code; return what stepbus said of it, in a sentence."""
        path = self.write(row, **scenario)
        self.out = self.out.with_name(self.out.name + "_")
        more = ["--in-process"] if in_process else []
        self._capfd.readouterr()
        ended = main(["run", path, "--out", str(self.out), "--no-report", *more, *words])
        said = self._capfd.readouterr().err
        assert ended == code, said
        assert "Traceback" not in said
        assert not list(self.temp.iterdir())
        return said

    def calls(self):
        """Return the calls of the FMU, in order."""
        return (self.folder / "calls").read_text().split()

    def recorded(self):
        """Return the number of outputs in the recording, read by code that is none of ours."""
        found = 0
        with (self.out / "run.mcap").open("rb") as stream, suppress(EndOfFile):
            for _, channel, _ in NonSeekingReader(stream).iter_messages(log_time_order=False):
                found += channel.topic == "m/out"
        return found


@pytest.fixture
def bench(tmp_path, own_temp, capfd):
    return Bench(tmp_path, own_temp, capfd)


# --- files ------------------------------------------------------------------------------------

CLOCK = '<Clock name="tick" valueReference="1" causality="input" intervalVariability="triggered"/>'
XML = fmus.xml3(bad_c.ROWS[3])
BROKEN = {
    "no zip": (b"hello", "not a zip file"),
    "empty": ({"readme.txt": ""}, "modelDescription.xml"),
    "broken XML": ({"modelDescription.xml": "<fmiModelDescription"}, "is no FMU"),
    "another XML": ({"modelDescription.xml": "<svg/>"}, "is no FMU"),
    "no numbers": ({"modelDescription.xml": XML.replace('"2"', '"two"')}, "'two' is not a valid value"),
    "FMI 1": (
        {"modelDescription.xml": '<fmiModelDescription fmiVersion="1.0" modelName="m" '
         'modelIdentifier="m" guid="g" numberOfContinuousStates="0" numberOfEventIndicators="0">'
         "<ModelVariables/></fmiModelDescription>"},
        "is for FMI 1.0; stepbus takes FMI 2.0 and 3.0",
    ),
    "no time": (
        {"modelDescription.xml": XML.replace(
            "<ModelVariables>", '<DefaultExperiment stopTime="soon"/><ModelVariables>')},
        "model.fmu: stopTime is 'soon', which is no number",
    ),
    "no step": (
        {"modelDescription.xml": XML.replace(
            "<CoSimulation ", '<CoSimulation fixedInternalStepSize="often" ')},
        "model.fmu: fixedInternalStepSize is 'often', which is no number",
    ),
    "FMI 4": ({"modelDescription.xml": XML.replace('"3.0"', '"4.0"')}, "4.0"),
    "model exchange": (
        {"modelDescription.xml": XML.replace("CoSimulation", "ModelExchange")},
        "has no co-simulation interface, only model exchange",
    ),
    "clocks": (
        {"modelDescription.xml": fmus.xml3([CLOCK])},
        "has clocks (tick)",
    ),
    "unknown type": (
        {"modelDescription.xml": fmus.xml3(['<Quaternion name="q" valueReference="1"/>'])},
        "Element 'Quaternion': This element is not expected",
    ),
    "size of an array": (
        {"modelDescription.xml": XML.replace(
            'causality="output"/>',
            'causality="output"><Dimension valueReference="9"/></Float64>')},
        "is no FMU",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", BROKEN)
def test_a_file_that_is_no_fmu_of_ours(bench, kind):
    content, text = BROKEN[kind]
    if isinstance(content, bytes):
        (bench.folder / "model.fmu").write_bytes(content)
    else:
        fmus.zipped(bench.folder / "model.fmu", content)
    said = bench.run(ExitCode.SCENARIO)
    assert text in said
    assert "model.fmu" in said


def test_no_file(bench):
    assert "no file 'model.fmu'" in bench.run(ExitCode.SCENARIO)
    (bench.folder / "model.fmu").mkdir()
    assert "no file 'model.fmu'" in bench.run(ExitCode.SCENARIO)


def test_a_file_named_alone(bench, capfd):
    (bench.folder / "model.fmu").write_text("hello")
    assert main(["run", str(bench.folder / "model.fmu")]) == ExitCode.SCENARIO
    assert "is no FMU" in capfd.readouterr().err


def test_a_file_that_a_recording_takes_for_data(bench):
    (bench.folder / "model.csv").write_text("")
    with pytest.raises(WiringError, match=r"ends with .fmu, not 'model.csv'"):
        read_model(bench.folder / "model.csv")


PROGRAMS = {
    "missing": ({"binaries/aarch64-darwin/model.dylib": b""}, "it has programs for aarch64-darwin"),
    "none": ({}, "it has programs for no platform"),
    "no library": ({"binaries/x86_64-linux/model.so": b"MZ"}, "Failed to load shared library"),
}


@pytest.mark.parametrize("kind", PROGRAMS)
def test_a_program_that_does_not_load(bench, kind):
    files, text = PROGRAMS[kind]
    fmus.zipped(bench.folder / "model.fmu", {"modelDescription.xml": XML, **files})
    before = Path.cwd()
    said = bench.run(ExitCode.START)
    assert Path.cwd() == before
    assert text in said
    assert "stepbus-fmi-" not in said


@pytest.mark.parametrize("major", [2, 3])
def test_another_token(bench, major):
    write = fmus.xml2 if major == 2 else fmus.xml3
    bad_c.bad(bench.folder, major=major, xml=write(bad_c.ROWS[major]).replace('"g"', '"other"'))
    assert "the token is wrong" in bench.run(ExitCode.START)


def test_functions_that_co_simulation_does_not_need_may_be_missing(bench):
    lacks = ("fmi2GetDerivatives", "fmi2EnterEventMode", "fmi2CancelStep", "fmi2GetFMUstate")
    bad_c.bad(bench.folder, major=2, missing=lacks)
    bench.run(ExitCode.FINISHED)


def test_a_function_that_is_needed_and_missing(bench):
    fmus.build_c(bench.folder, "int fmi3Version;", XML, missing=("fmi3InstantiateCoSimulation",))
    assert "fmi3InstantiateCoSimulation" in bench.run(ExitCode.START)


# --- scenarios --------------------------------------------------------------------------------

ROWS = [
    *bad_c.ROWS[3],
    '<Int8 name="n" valueReference="3" causality="parameter" variability="tunable" start="1"/>',
    '<Boolean name="b" valueReference="4" causality="parameter" variability="fixed" start="true"/>',
    '<Float64 name="a" valueReference="5" causality="parameter" start="1 2"><Dimension start="2"/></Float64>',
    '<Float64 name="hidden" valueReference="6" causality="local"/>',
]
WRONG = {
    "unknown start": ({"start": {"kk": 1}}, "no variable 'kk'"),
    "computed": ({"start": {"y": 1}}, "y is a continuous output variable that the FMU computes"),
    "not settable": ({"start": {"hidden": 1}}, "the FMU computes"),
    "text for a number": ({"start": {"k": "much"}}, "k is a number, such as 3, not 'much'"),
    "list for a number": ({"start": {"k": [1, 2]}}, "k is a finite number, not a list of 2"),
    "unit without one": ({"start": {"k": "3 mm"}}, "k has no unit"),
    "real for an integer": ({"start": {"n": 1.5}}, "n is an integer, not 1.5"),
    "too large": ({"start": {"n": 300}}, "n: [300] does not fit the type Int8"),
    "number for a boolean": ({"start": {"b": 1}}, "b is true or false, not 1"),
    "short array": ({"start": {"a": [1]}}, "a has 2 values (2), not 1"),
    "long array": ({"start": {"a": [1, 2, 3]}}, "a has 2 values (2), not 3"),
    "unknown published": ({"publish": ["z"]}, "no variable 'z'"),
    "unknown extrapolated": ({"extrapolate": ["z"]}, "no variable 'z'"),
    "cannot extrapolate": ({"extrapolate": ["u"]}, "cannot interpolate"),
    "no input extrapolated": ({"extrapolate": ["y"]}, "y is no input"),
}
WRONG_LINKS = {
    "no input": ({"y": "in.x"}, "y is no input of the FMU: its causality is output"),
    "unknown input": ({"v": "in.x"}, "no variable 'v'"),
    "no port": ({"u": "in.x"}, "'in.x' names no input port"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_scenario_that_does_not_fit(bench, kind):
    params, text = WRONG[kind]
    bad_c.bad(bench.folder, xml=fmus.xml3(ROWS))
    assert text in bench.run(ExitCode.START, row={"params": params})


@pytest.mark.parametrize("kind", WRONG_LINKS)
def test_a_link_that_does_not_fit(bench, capfd, kind):
    links, text = WRONG_LINKS[kind]
    bad_c.bad(bench.folder)
    row = {"params": {"inputs": links}}
    assert text in bench.run(ExitCode.START, row=row)
    assert main(["validate", bench.write(row)]) == ExitCode.SCENARIO
    assert text in capfd.readouterr().err
    assert main(["describe", bench.write(row)]) == ExitCode.START
    (said,) = capfd.readouterr().err.splitlines()
    assert text in said


def test_a_unit_without_a_factor(bench):
    wrong = '<UnitDefinitions><Unit name="q"><BaseUnit factor="0"/></Unit></UnitDefinitions>'
    bad_c.bad(bench.folder, xml=fmus.xml3(bad_c.ROWS[3], units=wrong))
    said = bench.run(ExitCode.SCENARIO)
    assert "model.fmu: the factor of unit 'q' is 0, which is no number to convert by" in said


def test_a_starter_of_an_fmu_has_no_controller(bench, capfd):
    size = '<UInt64 name="size" valueReference="7" causality="structuralParameter" start="2"/>'
    path, new = bad_c.bad(bench.folder, xml=fmus.xml3([*ROWS, size])), str(bench.folder / "new")
    with pytest.raises(SystemExit, match="2"):
        main(["new", "--fmu", str(path), "--language", "rust", new])
    assert "--language, --fmu" in capfd.readouterr().err
    assert main(["new", "--fmu", str(path), new]) == 0
    said = Path(new, "scenario.yaml").read_text()
    assert "# parameter a (2): fixed Float64 = 1 2" in said
    assert "# structuralParameter size: fixed UInt64 = 2" in said
    assert main(["validate", new]) == 0


def test_outputs_that_it_does_not_have(bench):
    bad_c.bad(bench.folder)
    row = {"outputs": {"cmd": "JointCommand/1"}, "params": {}}
    assert "say which variables JointCommand/1 has" in bench.run(ExitCode.START, row=row)
    row["params"] = {"outputs": {"cmd": {"names": ["j"], "mode": "position", "position": ["z"]}}}
    assert "JointCommand/1 has no field 'position'" in bench.run(ExitCode.START, row=row)
    row = {"outputs": {"more": "Integers/1"}}
    assert "has no such output variables" in bench.run(ExitCode.START, row=row)


@pytest.mark.parametrize("every", [1, 3])
def test_a_step_that_it_cannot_take(bench, every):
    bad_c.bad(bench.folder, can='fixedInternalStepSize="0.004"')
    said = bench.run(ExitCode.START, row={"every": every})
    assert f"whole multiples of 0.004 s only, and its step is {every / 100:g} s" in said
    bench.run(ExitCode.FINISHED, row={"every": 2})


# --- calls that fail --------------------------------------------------------------------------

FAILS = {
    "enter": (ExitCode.START, "EnterInitializationMode"),
    "exit": (ExitCode.START, "ExitInitializationMode"),
    "set": (ExitCode.START, "Set"),
    "get": (ExitCode.FAULT, "Get"),
    "doStep": (ExitCode.FAULT, "DoStep"),
}


@pytest.mark.parametrize("major", [2, 3])
@pytest.mark.parametrize("state", ["discard", "error", "fatal"])
@pytest.mark.parametrize("at", FAILS)
def test_a_call_that_fails(bench, major, state, at):
    code, name = FAILS[at]
    bad_c.bad(bench.folder, at, state, major)
    said = bench.run(code, row={"params": {"start": {"k": 1}}})
    assert f"fmi{major}{name}" in said
    assert f"returned {state}: it boils over" in said
    # What an FMU has called fatal must not be called again; after an error, it is only freed.
    last = bench.calls()[-2:]
    assert last == {"fatal": [last[0], at], "error": [at, "free"]}.get(state, last)
    assert last[-1] == "free" or state == "fatal"
    assert at == "doStep" or "terminate" not in bench.calls() or state == "discard"
    assert (bench.out / "run.mcap").exists()
    if at == "doStep":
        assert bench.recorded() == 4


@pytest.mark.parametrize("major", [2, 3])
def test_the_order_of_calls(bench, major):
    bad_c.bad(bench.folder, "terminate", "error", major)
    bench.run(ExitCode.FINISHED, row={"params": {"start": {"k": 1}}}, duration="20ms")
    begin = ["setup", "set", "enter"] if major == 2 else ["set", "enter"]
    steps = ["get", "doStep", "get", "doStep", "get"]
    assert bench.calls() == ["instantiate", *begin, "exit", *steps, "terminate", "free"]
    assert "it boils over" in (bench.out / "logs/m.log").read_text()


# --- programs that crash, hang or do as they like -----------------------------------------------

CRASHES = {
    ("instantiate", "segv"): (ExitCode.START, "was killed by SIGSEGV", 0),
    ("instantiate", "exit"): (ExitCode.START, "exited with code 3", 0),
    ("doStep", "segv"): (ExitCode.DIED, "was killed by SIGSEGV", 4),
    ("doStep", "abort"): (ExitCode.DIED, "was killed by SIGABRT", 4),
    ("doStep", "exit"): (ExitCode.DIED, "exited with code 3", 4),
    ("free", "segv"): (ExitCode.DIED, "while stopping; the recording is complete", 11),
}


@pytest.mark.parametrize(("at", "do"), CRASHES)
def test_a_crash(bench, at, do):
    code, text, outputs = CRASHES[at, do]
    bad_c.bad(bench.folder, at, do)
    assert text in bench.run(code, in_process=False)
    assert bench.recorded() == outputs


@pytest.mark.parametrize("do", ["hang", "chatter"])
def test_a_step_without_end(bench, do):
    bad_c.bad(bench.folder, "doStep", do)
    said = bench.run(ExitCode.STEP_TIMEOUT, row={"step_timeout": "500ms"}, in_process=False)
    assert "deadline 0.5 s (participants.m.step_timeout)" in said
    assert bench.recorded() == 4
    size = (bench.out / "logs/m.log").stat().st_size
    print("log", size, file=sys.stderr)


def test_what_an_fmu_prints_goes_to_its_log(bench):
    bad_c.bad(bench.folder, "doStep", "print")
    bench.run(ExitCode.FINISHED, in_process=False)
    print("log", (bench.out / "logs/m.log").stat().st_size, file=sys.stderr)
    assert "a line of text" in (bench.out / "logs/m.log").read_text()


@pytest.mark.parametrize("at", ["instantiate", "doStep"])
def test_an_fmu_that_changes_the_folder(bench, monkeypatch, at):
    monkeypatch.chdir(bench.folder)
    bad_c.bad(bench.folder, at, "chdir")
    bench.out = Path("relative")
    bench.run(ExitCode.FINISHED)
    assert Path.cwd() == bench.folder
    assert bench.recorded() == 11


def test_an_fmu_that_takes_the_signals(bench):
    bad_c.bad(bench.folder, "instantiate", "signals")
    bench.run(ExitCode.FINISHED, in_process=False)
    assert bench.recorded() == 11


def test_instances_one_after_the_other(bench):
    path = bad_c.bad(bench.folder)
    model = read_model(path)

    def once():
        instance = Instance(model, Params(fmu=path), {"k": [1.0]})
        instance.step(0.0, 0.01)
        instance.close()

    once()
    before = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(60):
        once()
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    assert not list(bench.temp.iterdir())
    assert bench.calls().count("free") == 61


def test_a_participant_that_is_killed_leaves_nothing(bench):
    bad_c.bad(bench.folder)
    said = bench.run(ExitCode.DIED, "--fault", "kill m at 4", in_process=False)
    assert "was killed by SIGKILL" in said
    assert bench.recorded() >= 4


def test_an_orchestrator_that_is_killed_leaves_nothing(bench):
    bad_c.bad(bench.folder, "doStep", "hang")
    path = bench.write()
    words = [str(Path(sys.executable).with_name("stepbus")), "run", path, "--out", str(bench.out)]
    run = subprocess.Popen([*words, "--no-report"], stderr=subprocess.PIPE, text=True)
    calls = bench.folder / "calls"
    assert comes_true(lambda: calls.exists() and calls.read_text().count("doStep") == 4)
    assert list(bench.temp.rglob("modelDescription.xml"))
    run.kill()
    assert "Traceback" not in run.communicate(timeout=60)[1]
    assert comes_true(lambda: not processes_in(bench.folder) and not list(bench.temp.iterdir()))
    print(bench.recorded(), file=sys.stderr)
