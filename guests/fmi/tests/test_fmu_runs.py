"""FMUs in runs: ports of every type, units, steps, events, ends, state, replay and branches."""

import json
import math

import echo_c
import fmus
import pytest

from stepbus import Recording
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode

PATIENT = dict.fromkeys(("spawn_timeout", "ready_timeout", "step_timeout", "stop_timeout"), "60s")
START = {
    "x": "3 mm", "float32": 0.5, "int8": -3, "uint8": 200, "int16": -300, "uint16": 60000,
    "int32": -70000, "uint32": 4000000000, "int64": -(2**60), "uint64": 2**63 + 5, "flag": True,
    "text": "grüße", "data": "0102ff", "colour": "blue", "size": 3, "a": [1, 2, 3],
}  # fmt: skip
FED = {"participant": "echo.fmu", "inputs": {"in": "src.out"}}
SOURCE = """
class Source(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.out, self.k, self.count, self.on, self.word = 0.0, 1.0, 0, False, ""
        output = {"causality": Fmi2Causality.output}
        self.register_variable(Real("out", **output))
        self.register_variable(Real("k", causality=Fmi2Causality.parameter,
            variability=Fmi2Variability.tunable))
        self.register_variable(Integer("count", **output, variability=Fmi2Variability.discrete))
        self.register_variable(Boolean("on", **output, variability=Fmi2Variability.discrete))
        self.register_variable(String("word", **output, variability=Fmi2Variability.discrete))
    def do_step(self, t, h):
        self.out += self.k * h
        self.count += 1
        self.on, self.word = self.count % 2 == 1, str(self.count)
        return True
"""


class Bench:
    """Runs scenarios in a folder."""

    def __init__(self, folder, temp, capfd):
        self.folder, self._temp, self._capfd = folder, temp, capfd
        self.said = ""
        self._number = 0

    def command(self, *words, code=ExitCode.FINISHED):
        """Run a command to its exit code; return what it wrote to standard output."""
        self._capfd.readouterr()
        ended = main([str(word) for word in words])
        out, self.said = self._capfd.readouterr()
        assert ended == code, out + self.said
        assert "Traceback" not in self.said
        assert not list(self._temp.iterdir())
        return out

    def new(self):
        """Return a folder for a run."""
        self._number += 1
        return self.folder / f"out{self._number}"

    def write(self, participants, **scenario):
        """Write a scenario; return its file."""
        rows = {name: {**PATIENT, **row} for name, row in participants.items()}
        data = {"name": "x", "step": "10ms", "duration": "50ms", **scenario, "participants": rows}
        path = self.folder / "x.yaml"
        path.write_text(json.dumps(data))
        return path

    def run(self, participants, *words, code=ExitCode.FINISHED, in_process=True, **scenario):
        """Run participants; return the recording."""
        path, out = self.write(participants, **scenario), self.new()
        more = ["--in-process"] if in_process else []
        self.command("run", path, "--out", out, "--no-report", *more, *words, code=code)
        return Recording(out / "run.mcap") if (out / "run.mcap").exists() else None


def values(recording, port):
    return [message.values for _, message in recording.messages(port)]


def first(recording, port):
    return [message.values[0] for _, message in recording.messages(port)]


@pytest.fixture
def bench(tmp_path, own_temp, capfd):
    return Bench(tmp_path, own_temp, capfd)


# --- ports ------------------------------------------------------------------------------------


def test_values_of_every_type_of_fmi_3_go_from_one_fmu_to_another(bench):
    echo_c.echo(bench.folder)
    ports = {
        "r": "out",
        "i": "out_integers",
        "b": "out_booleans",
        "t": "out_texts",
        "d": "out_binaries",
    }
    whole = ["int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "colour"]
    names = {"r": ["x", "float32", "a"], "i": whole, "b": ["flag"], "t": ["text"], "d": ["data"]}
    links = {name: f"{port}.{name}_out" for port, some in names.items() for name in some}
    inputs = {port: f"a.{source}" for port, source in ports.items()}
    params = {"inputs": links, "start": {"size": 3}}
    recording = bench.run({
        "a": {"participant": "echo.fmu", "params": {"start": START}},
        "b": {"participant": "echo.fmu", "inputs": inputs, "params": params},
    })  # fmt: skip
    assert values(recording, "a/out")[-1] == pytest.approx([0.003, 0.5, 2, 4, 6, 0.05])
    assert values(recording, "b/out")[-1] == pytest.approx([0.003, 0.5, 4, 8, 12, 0.05])
    numbers = [START[name] for name in whole[:-1]]
    for who in "ab":
        assert values(recording, f"{who}/out_integers")[-1] == [*numbers, 4, 0]
        assert values(recording, f"{who}/out_booleans")[-1] == [True]
        assert values(recording, f"{who}/out_texts")[-1] == ["grüße"]
        assert values(recording, f"{who}/out_binaries")[-1] == [b"\x01\x02\xff"]
    described = recording["a/out"].description
    assert described.names == ["x_out", "float32_out", "a_out[1]", "a_out[2]", "a_out[3]", "sum"]
    assert described.details["unit"][0] == "m"


def test_values_of_every_type_of_fmi_2(bench):
    fmus.build(bench.folder, SOURCE)
    echo_c.echo_2(bench.folder)
    links = {"x": {"from": "in.out", "convert": False}, "colour": "n.count"}
    echo = {
        **FED,
        "inputs": {"in": "src.out", "n": "src.out_integers"},
        "params": {"inputs": links},
    }
    recording = bench.run({"src": {"participant": "Source.fmu"}, "echo": echo})
    assert first(recording, "src/out") == pytest.approx([0, 0.01, 0.02, 0.03, 0.04, 0.05])
    assert first(recording, "src/out_integers") == [0, 1, 2, 3, 4, 5]
    assert first(recording, "src/out_booleans") == [False, True, False, True, False, True]
    assert first(recording, "src/out_texts") == ["", "1", "2", "3", "4", "5"]
    # The plant publishes its state, then takes its inputs: one step of delay.
    assert first(recording, "echo/out") == pytest.approx([0, 0, 0.01, 0.02, 0.03, 0.04])
    assert first(recording, "echo/out_integers") == [0, 0, 1, 2, 3, 4]


def test_published_last_there_is_no_delay(bench):
    fmus.build(bench.folder, SOURCE)
    echo_c.echo_2(bench.folder)
    echo = {**FED, "publishes": "last", "params": {"inputs": {"x": "in.out"}}}
    recording = bench.run({"src": {"participant": "Source.fmu"}, "echo": echo})
    assert first(recording, "echo/out") == pytest.approx([0, 0.01, 0.02, 0.03, 0.04])


def test_every_fourth_step(bench):
    fmus.build(bench.folder, SOURCE)
    echo = {"participant": "Source.fmu", "every": 4}
    recording = bench.run({"src": echo}, duration="120ms")
    assert [step for step, _ in recording.messages("src/out")] == [0, 4, 8, 12]
    assert first(recording, "src/out") == pytest.approx([0, 0.04, 0.08, 0.12])


def test_links_have_factor_offset_and_units(bench):
    echo_c.echo(bench.folder)
    params = {
        "start": {"rate": "1 m"},
        "inputs": {"x": {"from": "in.x_out", "factor": 2, "offset": 3}},
    }
    source = {"participant": "echo.fmu", "params": {"start": {"x": "1 m"}}}
    recording = bench.run({"src": source, "echo": {**FED, "params": params}})
    assert first(recording, "echo/out")[-1] == 5.0
    assert values(recording, "echo/out")[-1][-1] == pytest.approx(1000 * 0.05)
    # From a message whose field has a unit: radians do not measure a length.
    joints = {"participant": "echo.fmu", "outputs": {"state": "JointState/1"},
              "params": {"outputs": {"state": {"names": ["j"], "position": ["sum"], "velocity": ["sum"]}}}}  # fmt: skip
    wrong = {**FED, "inputs": {"in": "src.state"}, "params": {"inputs": {"x": "in.position[0]"}}}
    bench.run({"src": joints, "echo": wrong}, code=ExitCode.FAULT)
    assert "unit 'rad' is no 'm': they measure different quantities" in bench.said
    wrong["params"] = {"inputs": {"x": {"from": "in.position[j]", "convert": False}}}
    recording = bench.run({"src": joints, "echo": wrong})
    assert first(recording, "echo/out")[-1] == pytest.approx(0.04)


def test_a_unit_that_does_not_fit(bench):
    echo_c.echo(bench.folder)
    row = {"participant": "echo.fmu", "params": {"start": {"x": "3 kg"}}}
    bench.run({"m": row}, code=ExitCode.START)
    assert "unit 'kg' is no 'm'" in bench.said
    row["params"]["start"]["x"] = "3 furlops"
    bench.run({"m": row}, code=ExitCode.START)
    assert "unknown unit 'furlops'" in bench.said


def test_outputs_are_mapped_to_a_message(bench):
    echo_c.echo(bench.folder)
    fields = {"names": ["j1", "j2"], "mode": "torque", "values": ["a_out[2]", "sum"]}
    row = {"participant": "echo.fmu", "outputs": {"command": "JointCommand/1"},
           "params": {"outputs": {"command": fields}, "start": {"a": [1, 2]}}}  # fmt: skip
    recording = bench.run({"m": row})
    _, message = list(recording.messages("m/command"))[-1]
    assert message.mode == "torque"
    assert message.values == pytest.approx([4, 0.05])
    assert recording["m/command"].description.names == ["j1", "j2"]


def test_parameters_from_the_command_line(bench):
    echo_c.echo(bench.folder)
    recording = bench.run({"m": {"participant": "echo.fmu"}}, "--set", "m.params.start.rate=200",
                          "--set", "m.params.publish=[inner]")  # fmt: skip
    assert values(recording, "m/out")[-1][-2:] == pytest.approx([10.0, 0.0])
    assert recording["m/out"].description.names[-1] == "inner"


# --- steps, events, ends ----------------------------------------------------------------------


@pytest.mark.parametrize("uses", [True, False])
def test_a_discrete_input_changes_in_an_event(bench, uses):
    fmus.build(bench.folder, SOURCE)
    echo_c.echo(bench.folder, can='hasEventMode="true"')
    params = {"inputs": {"int32": "in.count"}, "event_mode": uses}
    echo = {**FED, "inputs": {"in": "src.out_integers"}, "params": params}
    recording = bench.run({"src": {"participant": "Source.fmu", "every": 2}, "echo": echo})
    got = values(recording, "echo/out_integers")
    assert [row[4] for row in got] == [0, 0, 0, 1, 1, 2]
    # Two updates for each event: at the start, and for each of the new values.
    assert [row[-1] for row in got] == ([2, 2, 2, 4, 4, 6] if uses else [0] * 6)


def test_an_early_return_is_continued(bench):
    echo_c.echo(bench.folder, "EARLY", can='hasEventMode="true"')
    recording = bench.run({"m": {"participant": "echo.fmu"}})
    assert values(recording, "m/out")[-1][-1] == pytest.approx(0.05)
    assert values(recording, "m/out_integers")[-1][-1] == 2 + 5 * 2


@pytest.mark.parametrize("make", [echo_c.echo, echo_c.echo_2])
@pytest.mark.parametrize("publishes", ["first", "last"])
def test_an_fmu_ends_the_run(bench, make, publishes):
    make(bench.folder, "ENDS")
    recording = bench.run({"m": {"participant": "echo.fmu", "publishes": publishes}}, duration="1s")
    # A plant sends its wish with its next outputs.
    last = [step for step, _ in recording.messages("m/out")][-1]
    assert last == {"first": 7, "last": 5}[publishes]
    result = json.loads((bench.folder / "out1/result.json").read_text())
    assert "the FMU echo ends the simulation" in result["reason"]


def test_an_input_is_extrapolated(bench):
    fmus.build(bench.folder, SOURCE)
    echo_c.echo_2(bench.folder, can='canInterpolateInputs="true"')
    params = {"inputs": {"x": "in.out"}, "extrapolate": ["x"]}
    recording = bench.run({"src": {"participant": "Source.fmu"}, "echo": {**FED, "params": params}})
    # At t, the ramp is at t; extrapolated to the end of the step, the echo has no delay.
    assert first(recording, "echo/out") == pytest.approx([0, 0, 0.02, 0.03, 0.04, 0.05])


# --- state, and what is repeated ----------------------------------------------------------------


def test_describe(bench):
    echo_c.echo(bench.folder, can='canGetAndSetFMUState="true" canSerializeFMUState="true"')
    fmus.build(bench.folder, SOURCE)
    echo = {**FED, "params": {"inputs": {"x": "in.out"}, "start": {"size": 4}}}
    path = bench.write({"src": {"participant": "Source.fmu"}, "echo": echo})
    out = bench.command("describe", path)
    for text in (
        "FMI 3.0: echo", "can save its state", "input     a (4): continuous Float64 = 0 0",
        "parameter rate: tunable Float64 = 1 [mm]", "in ← src.out:", "one step of delay",
        "FMI 2.0: Source",
    ):  # fmt: skip
        assert text in out, out


def test_a_run_is_replayed_repeated_and_the_same_in_processes(bench):
    echo_c.echo(bench.folder)
    fmus.build(bench.folder, SOURCE)
    echo = {**FED, "params": {"inputs": {"x": "in.out"}}}
    rows = {"src": {"participant": "Source.fmu"}, "echo": echo}
    one, two = bench.run(rows), bench.run(rows, in_process=False)
    assert one.path.read_bytes() == two.path.read_bytes()
    assert "echo: equal" in bench.command("replay", one.path, "--participant", "echo")
    out = bench.command("rerun", one.path, "--out", bench.new())
    assert "byte for byte" in out


SAVES = 'canGetAndSetFMUState="true" canSerializeFMUState="true"'


def test_a_branch_starts_from_a_saved_state(bench):
    echo_c.echo(bench.folder, can=SAVES)
    recording = bench.run({"m": {"participant": "echo.fmu"}}, checkpoint="20ms")
    assert not bench.said
    out = bench.command("branch", recording.path, "--at", 4, "--out", bench.new(), "--json",
                        "--no-report", "--in-process")  # fmt: skip
    assert json.loads(out)["restored"] == {"m": 2}
    assert (bench.folder / "out2/run.mcap").read_bytes() == recording.path.read_bytes()


def test_a_tunable_parameter_is_set_by_a_call(bench):
    echo_c.echo(bench.folder)
    recording = bench.run({"m": {"participant": "echo.fmu"}})
    words = ("branch", recording.path, "--at", 3, "--no-report", "--in-process", "--call")
    bench.command(*words, "m set rate '11 mm'", "--out", bench.new())
    branched = Recording(bench.folder / "out2/run.mcap")
    assert [row[-1] for row in values(branched, "m/out")] == pytest.approx(
        [0, 0.01, 0.02, 0.03, 0.14, 0.25]
    )
    bench.command(*words, "m set inner 3", "--out", bench.new(), code=ExitCode.SCENARIO)
    assert "inner is not tunable" in bench.said


WHY = {
    "no state": ((), "", "it cannot save its state (canSerializeFMUState)"),
    "another way": (("FORGETS",), SAVES, "restored in another process, it goes another way"),
    "crash": (("POINTERS",), SAVES, "it ended with signal 6"),
}


@pytest.mark.parametrize("kind", WHY)
def test_without_a_state_that_holds_a_branch_starts_at_step_0(bench, kind):
    defines, can, why = WHY[kind]
    echo_c.echo(bench.folder, *defines, can=can)
    recording = bench.run({"m": {"participant": "echo.fmu"}}, checkpoint="20ms")
    (warned,) = json.loads(recording.path.with_name("result.json").read_text())["warnings"]
    assert "no checkpoints of echo.fmu: " in warned["text"]
    assert why in warned["text"]
    out = bench.command("branch", recording.path, "--at", 4, "--out", bench.new(), "--json",
                        "--no-report", "--in-process")  # fmt: skip
    assert json.loads(out)["restored"] == {}
    assert math.isclose(values(Recording(bench.folder / "out2"), "m/out")[-1][-1], 0.05)
