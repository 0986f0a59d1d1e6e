"""What `recover` reads and writes, and what it refuses."""

import pytest

from stepbus_orchestrator.errors import ExitCode, OutputExists, RecordingFailed
from stepbus_orchestrator.recording import recover


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "has 0 bytes: there is nothing to"),
        (b"\x89MCAP", "has 5 bytes: there is nothing to"),
        (b"\x89MCAP0\r\n\x01", "has 9 bytes and no complete record:"),
        (b"PK\x03\x04 a zip file", "is not an MCAP recording"),
    ],
)
def test_a_file_with_nothing_to_recover_is_refused(tmp_path, content, sentence):
    source = tmp_path / "broken.mcap"
    source.write_bytes(content)
    with pytest.raises(RecordingFailed, match=rf"broken\.mcap {sentence}") as caught:
        recover(source, tmp_path / "fixed.mcap")
    assert caught.value.code == ExitCode.RECORDING == 8
    assert [path.name for path in tmp_path.iterdir()] == ["broken.mcap"]


@pytest.mark.parametrize("name", ["absent.mcap", "."])
def test_a_file_that_cannot_be_read_is_named(tmp_path, name):
    with pytest.raises(RecordingFailed, match="cannot be read"):
        recover(tmp_path / name, tmp_path / "fixed.mcap")


def test_a_target_that_exists_is_not_touched(two_link_recording, tmp_path):
    target = tmp_path / "fixed.mcap"
    target.write_text("precious")
    with pytest.raises(OutputExists, match="choose another name with --out"):
        recover(two_link_recording, target)
    assert target.read_text() == "precious"


def test_a_target_in_no_folder_is_named(two_link_recording, tmp_path):
    with pytest.raises(RecordingFailed, match=r"fixed\.mcap cannot be written"):
        recover(two_link_recording, tmp_path / "absent" / "fixed.mcap")


def test_in_place_the_file_is_replaced_when_the_new_one_is_complete(two_link_recording, tmp_path):
    broken = tmp_path / "run.mcap"
    broken.write_bytes(two_link_recording.read_bytes()[:-100])
    recover(broken, broken, in_place=True)
    assert broken.read_bytes() == two_link_recording.read_bytes()
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]
