"""Recordings that each released layout has written are read, compared, exported, recovered, replayed.

`released/layout_N.mcap` is two_link for 500 ms, recorded by a stepbus of that layout.
"""

import json

import pytest
from support.messages.recordings import rewrite
from support.paths import CHECKOUT
from support.runs.conformance import ours

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode, RecordingFailed
from stepbus_orchestrator.recording import recover
from stepbus_orchestrator.recording.layout import LIBRARIES, LIBRARY
from stepbus_orchestrator.recording.reader import Recording

RELEASED = CHECKOUT / "tests/orchestrator/recording/released"
LAYOUTS = {"stepbus": "layout_1", "stepbus 2": "layout_2", "stepbus 3": "layout_3"}
HASH = "b91b1de8151b3c088dbcbe1e4812add0bd221a970db2b412d2185671b91d1ce0"
PAGE = (CHECKOUT / "docs/compatibility.md").read_text(encoding="utf-8")

every_layout = pytest.mark.parametrize("path", [RELEASED / f"{it}.mcap" for it in LAYOUTS.values()])
every_recording = pytest.mark.parametrize("path", sorted(RELEASED.glob("*.mcap")))


def info(path, capsys):
    assert main(["info", str(path), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_every_layout_has_a_recording_and_a_row_in_the_page():
    assert LAYOUTS.keys() == LIBRARIES
    for library, name in LAYOUTS.items():
        path = RELEASED / f"{name}.mcap"
        with Recording(path) as recording:
            assert recording.damage == ""
        assert library.encode() in path.read_bytes()[:40]
        assert f"| `{library}` |" in PAGE
        assert path.name in PAGE


@every_layout
def test_each_has_the_messages_of_the_others(path, capsys):
    assert info(path, capsys)["messages_sha256"] == HASH
    assert main(["diff", str(path), str(RELEASED / f"{LAYOUTS[LIBRARY]}.mcap")]) == 0
    assert capsys.readouterr().out.startswith("equal: 401 messages on 4 ports")


@pytest.mark.slow
@every_recording
def test_each_is_exported_and_reported(path, tmp_path, capsys):
    copy = tmp_path / "run.mcap"
    copy.write_bytes(path.read_bytes())
    assert main(["export", str(copy), "--csv", str(tmp_path / "all.csv")]) == 0
    assert main(["report", str(copy)]) == 0
    assert "joint1" in (tmp_path / "all.csv").read_text(encoding="utf-8")
    assert "controller" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert capsys.readouterr().err == ""


@every_recording
def test_each_is_recovered_when_it_was_cut_off(path, tmp_path):
    whole, cut = path.read_bytes(), tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 9 // 10])
    recovery = recover(cut, tmp_path / "fixed.mcap")
    with Recording(path) as before, Recording(recovery.target) as after:
        assert after.damage == ""
        assert 0 < len(after["plant/joint_state"]) <= len(before["plant/joint_state"])


@pytest.mark.slow
@every_layout
def test_each_is_replayed(path, capsys):
    words = ours("controller")  # the first two name a program of a stepbus of their time
    assert main(["replay", str(path), "--participant", "controller", "--exec", *words]) == 0
    assert "equal to the recording over 100 steps" in capsys.readouterr().out


def test_a_recording_of_a_later_layout_is_one_error(tmp_path, capsys):
    later = rewrite(RELEASED / "layout_3.mcap", tmp_path / "later.mcap", 4096, library="stepbus 4")
    sentence = (
        f"{later} has layout 'stepbus 4', which is newer than this stepbus: it reads layouts up to "
        "'stepbus 3'; update stepbus (docs/compatibility.md)"
    )
    for use in (Recording, lambda path: recover(path, tmp_path / "fixed.mcap")):
        with pytest.raises(RecordingFailed) as caught:
            use(later)
        assert str(caught.value) == sentence
    for command in (["info"], ["report"], ["replay", "--participant", "plant"]):
        assert main([command[0], str(later), *command[1:]]) == ExitCode.RECORDING
        assert capsys.readouterr() == ("", f"stepbus: {sentence}\n")
    assert [path.name for path in tmp_path.iterdir()] == ["later.mcap"]
