"""Each participant of two_link is equal to its recording to the bit; another gain is found."""

import pytest

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.analysis.tolerance import FieldTolerance, Tolerance
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode, OutputExists
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay import replay
from stepbus_schemas import WiringError

STEPS = 60
OTHER_GAIN = ["controller.params.kp=101"]


@pytest.mark.parametrize(
    ("participant", "ports", "messages"),
    [("controller", 2, STEPS), ("mission", 1, STEPS), ("plant", 1, STEPS + 1)],
)
def test_a_participant_is_equal_to_its_recording_to_the_bit(
    two_link_recording, participant, ports, messages
):
    result = replay(two_link_recording, participant)
    assert (result.equal, result.divergence, list(result.notes)) == (True, None, [])
    assert [port.equal for port in result.ports] == [messages] * ports


@pytest.mark.parametrize("window", [1, 7])
def test_the_window_changes_no_result(two_link_recording, window):
    assert replay(two_link_recording, "controller", window=window).equal


@pytest.fixture(scope="module")
def other_gain(two_link_recording):
    return replay(two_link_recording, "controller", set=OTHER_GAIN)


def test_another_gain_is_found_at_the_first_step_it_changes(other_gain, two_link_recording):
    found = other_gain.divergence
    # At step 0 the arm stands on its reference, so that kp has nothing to multiply.
    assert (found.step, found.topic, found.field) == (1, "controller/command", "values[0]")
    recorded = dict(Recording(two_link_recording).messages("controller/command"))
    assert found.first == recorded[1].values[0]
    assert found.second != found.first


def test_the_inputs_of_the_divergent_step_are_shown(other_gain, two_link_recording):
    recorded = dict(Recording(two_link_recording).messages("plant/joint_state"))
    held = other_gain.inputs["joint_state"]
    assert (held.topic, held.step) == ("plant/joint_state", 1)
    assert held.value["position"] == recorded[1].position
    assert set(other_gain.inputs) == {"joint_state", "reference"}


def test_every_field_has_its_count_and_largest_difference(other_gain):
    command, status = other_gain.ports
    assert (command.topic, command.different, command.equal) == ("controller/command", 59, 1)
    (count,) = command.fields
    assert (count.field, count.beyond) == ("values", 59)
    assert count.largest > 0
    assert (status.topic, status.equal) == ("controller/status", STEPS)


def test_a_tolerance_lets_another_gain_pass(two_link_recording):
    tolerance = Tolerance({("controller/command", "values"): FieldTolerance(abs=10.0)})
    result = replay(two_link_recording, "controller", set=OTHER_GAIN, tolerance=tolerance)
    assert (result.equal, result.ports[0].within) == (True, 59)


def test_the_command_says_it_and_exits_with_its_code(two_link_recording, capsys):
    words = ["replay", str(two_link_recording), "--participant", "controller"]
    assert main([*words, "--set", *OTHER_GAIN]) == ExitCode.DIFFERENT
    assert "step 1: controller/command: values" in (capsys.readouterr().out)


def test_an_update_is_a_recording_that_differs_in_this_participant_only(
    two_link_recording, tmp_path
):
    target = tmp_path / "new.mcap"
    replay(two_link_recording, "controller", set=OTHER_GAIN, update=target)
    found = diff(two_link_recording, target)
    assert [port.topic for port in found.ports if port.divergence] == ["controller/command"]
    assert found.notes == ["attachment scenario.yaml differs"]
    assert replay(target, "controller").equal


def test_an_update_without_a_change_is_the_recording_byte_for_byte(two_link_recording, tmp_path):
    replay(two_link_recording, "plant", update=tmp_path / "new.mcap")
    assert (tmp_path / "new.mcap").read_bytes() == two_link_recording.read_bytes()


def test_an_update_never_replaces_a_file(two_link_recording):
    before = two_link_recording.read_bytes()
    with pytest.raises(OutputExists, match="already exists; choose another name"):
        replay(two_link_recording, "controller", update=two_link_recording)
    assert two_link_recording.read_bytes() == before


def test_a_participant_that_is_not_there_is_refused(two_link_recording):
    with pytest.raises(WiringError, match="did you mean 'controller'"):
        replay(two_link_recording, "controler")


def test_a_tolerance_for_a_field_that_is_not_there_is_refused(two_link_recording):
    tolerance = Tolerance({("controller/command", "value"): FieldTolerance(abs=1.0)})
    with pytest.raises(WiringError, match="no field 'value' in controller/command"):
        replay(two_link_recording, "controller", tolerance=tolerance)
