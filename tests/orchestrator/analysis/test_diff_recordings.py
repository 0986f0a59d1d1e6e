"""Two recordings are compared port by port, the first divergence first."""

import json

import pytest
from support.messages.recordings import rewrite

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.analysis.tolerance import FieldTolerance, Tolerance
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import McapFile
from stepbus_schemas import Event, JointReference, encode

STEP_NS = 5_000_000


def event(text):
    return encode(Event(level="info", text=text))


def reference(value):
    vector = [value, 0.0]
    return encode(JointReference(position=vector, velocity=vector, acceleration=vector))


def write(path, texts, values, attachment=b"a"):
    """Write a recording with `log/event` and `mission/reference`; None for no message at a step."""
    file = McapFile(path)
    file.attach("scenario.yaml", attachment)
    event_channel = file.add_channel("log/event", "Event/1", {})
    reference_channel = file.add_channel("mission/reference", "JointReference/1", {})
    for step, (text, value) in enumerate(zip(texts, values, strict=True)):
        if text is not None:
            file.add(event_channel, step * STEP_NS, event(text), step)
        if value is not None:
            file.add(reference_channel, step * STEP_NS, reference(value), step)
    file.close()
    return path


@pytest.fixture
def first(tmp_path):
    return write(tmp_path / "first.mcap", "abcd", [1.0, 2.0, 3.0, 4.0])


def test_equal_recordings_are_equal(first, tmp_path):
    found = diff(first, write(tmp_path / "second.mcap", "abcd", [1.0, 2.0, 3.0, 4.0]))
    assert (found.equal, found.divergence, found.notes) == (True, None, [])
    assert found.text().startswith("equal: 8 messages on 2 ports")


def test_the_first_divergence_comes_first(first, tmp_path):
    found = diff(first, write(tmp_path / "second.mcap", "abcx", [1.0, 2.0, 3.5, 4.0]))
    assert [port.topic for port in found.ports] == ["mission/reference", "log/event"]
    assert (found.divergence.step, found.divergence.field) == (2, "position[0]")
    assert found.text().startswith("first divergence: step 2:")
    assert "1 of 4 messages differ" in found.text()


@pytest.mark.parametrize(
    ("texts", "values", "step", "kind", "words"),
    [
        ("ab", [1.0, 2.0], 2, "missing", "2 only in the first"),
        ("abcde", [1.0, 2.0, 3.0, 4.0, 5.0], 4, "added", "the first ends at step 3"),
    ],
)
def test_a_recording_of_another_length_says_what_one_lacks(
    first, tmp_path, texts, values, step, kind, words
):
    found = diff(first, write(tmp_path / "second.mcap", texts, values))
    assert (found.divergence.step, found.divergence.type) == (step, kind)
    assert words in found.text()


def test_a_message_left_out_between_others_is_missing_once(first, tmp_path):
    second = write(tmp_path / "second.mcap", ["a", None, "c", "d"], [1.0, 2.0, 3.0, 4.0])
    (port,) = [port for port in diff(first, second).ports if port.divergence]
    assert (port.topic, port.missing, port.equal, port.divergence.step) == ("log/event", 1, 3, 1)


def test_a_port_that_one_lacks_is_a_difference(two_link_recording, first):
    found = diff(two_link_recording, first)
    assert list(found.only_second) == ["log/event"]
    assert "controller/command" in found.only_first
    assert not found.equal


def test_a_tolerance_makes_recordings_equal(first, tmp_path):
    second = write(tmp_path / "second.mcap", "abcd", [1.0, 2.0, 3.001, 4.0])
    tolerance = Tolerance({("mission/reference", "*"): FieldTolerance(abs=0.01)})
    assert diff(first, second, tolerance).equal


def test_what_differs_around_the_messages_is_noted(first, tmp_path):
    found = diff(first, write(tmp_path / "second.mcap", "abcd", [1.0, 2.0, 3.0, 4.0], b"b"))
    assert (found.equal, found.notes) == (True, ["attachment scenario.yaml differs"])


def test_a_recording_cut_off_is_compared_up_to_its_end(two_link_recording, tmp_path):
    fine = rewrite(two_link_recording, tmp_path / "fine.mcap", 4096)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(fine.read_bytes()[: fine.stat().st_size // 2])
    found = diff(two_link_recording, cut)
    assert {port.different for port in found.ports} == {0}
    assert found.divergence.type == "missing"
    assert "cut.mcap is damaged: " in found.notes[0]


def test_the_command_exits_with_its_code_and_prints_json_for_programs(first, tmp_path, capsys):
    second = write(tmp_path / "second.mcap", "abcx", [1.0, 2.0, 3.0, 4.0])
    assert main(["diff", str(first), str(first)]) == ExitCode.FINISHED
    capsys.readouterr()
    assert main(["diff", str(first), str(second), "--json"]) == ExitCode.DIFFERENT
    found = json.loads(capsys.readouterr().out)
    assert found["divergence"]["topic"] == "log/event"
    assert (found["divergence"]["first"], found["divergence"]["second"]) == ("d", "x")


def test_a_file_that_is_no_recording_is_refused(first, tmp_path, capsys):
    (tmp_path / "text.mcap").write_text("hello, I am no recording")
    assert main(["diff", str(first), str(tmp_path / "text.mcap")]) == ExitCode.RECORDING
    assert "is not an MCAP recording" in capsys.readouterr().err
