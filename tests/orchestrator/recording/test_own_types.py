"""Messages of one's own types in recordings: read, compared and plotted without the scenario."""

import msgspec
import numpy as np
import pytest

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.recording import McapFile, Recorder, Recording
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_orchestrator.scenario.ports import OutputSpec
from stepbus_schemas import Description, Outputs, Types, WiringError, encode
from stepbus_tools.run_lines import after_run
from stepbus_tools.viewing.page import write_page

STEP_NS = 1_000_000
THRUSTER = {
    "thrust": {"type": "float[n]", "unit": "N"},
    "mode": ["off", "on"],
    "at": {"type": "float[3]", "optional": True},
}


def record(path, declaration, message, *, port_type="Thruster/1", steps=3):
    """Record a message with its number of thrust; it may be wrong in the other fields."""
    types = Types({"Thruster/1": declaration})
    spec = ParticipantSpec(name="vehicle", exec=("x",), outputs={"out": OutputSpec(type=port_type)})
    recorder = Recorder(McapFile(path), [spec], STEP_NS, types=types)
    description = Description(names=["left", "right"])
    recorder.open_channels({"vehicle": {"out": description}}, {})
    for step in range(steps):
        raw = msgspec.Raw(encode(message(types, step)))
        ports = {"out": raw}
        recorder.offer("vehicle", Outputs(token="", step=step, t_ns=step * STEP_NS, ports=ports))
    recorder.finish(steps - 1, ["vehicle"])


def thruster(types, step):
    return types["Thruster/1"](thrust=[float(step), 1.0], mode="on")


@pytest.fixture
def path(tmp_path):
    record(tmp_path / "run.mcap", THRUSTER, thruster)
    return tmp_path / "run.mcap"


def test_a_recording_is_read_by_its_own_schemas(path):
    with Recording(path) as recording:
        port = recording["vehicle.out"]
        assert port.type == "Thruster/1"
        np.testing.assert_array_equal(port.thrust, [[0, 1], [1, 1], [2, 1]])
        assert list(port.mode) == ["on"] * 3
        assert [step for step, message in port.messages() if message.thrust[0] > 0] == [1, 2]
        assert recording.types == Types({"Thruster/1": THRUSTER})
        with pytest.raises(WiringError, match="did you mean 'thrust'"):
            port["thrusts"]


def test_two_recordings_of_the_same_type_are_compared_field_by_field(path, tmp_path):
    other = tmp_path / "other.mcap"
    record(other, THRUSTER, lambda types, _: types["Thruster/1"](thrust=[0.0, 1.0], mode="on"))
    found = diff(path, other)
    assert (found.equal, found.divergence.step, found.divergence.field) == (False, 1, "thrust[0]")


def test_types_that_differ_are_named_and_compared_as_they_are(path, tmp_path):
    other = tmp_path / "other.mcap"
    declaration = {**THRUSTER, "thrust": {"type": "float[n]", "unit": "kN"}}
    record(other, declaration, thruster)
    found = diff(path, other)
    assert found.equal
    assert 'unit "kN" in the second' in " ".join(found.notes)


def test_a_run_without_joints_is_plotted_by_its_own_types(path):
    assert after_run(path, has_plots=True)[0] == f"plots     {path.with_name('report.png')}"


def test_the_page_of_a_run_shows_its_own_types_with_their_units(path):
    text = write_page([path]).read_text()
    assert '"title":"vehicle.out (Thruster/1)"' in text
    assert '"title":"thrust","unit":"N"' in text
    assert '"label":"left"' in text
