"""What `stepbus branch` prints, and its exit codes."""

import json

import pytest
from support.messages.recordings import chunks, rewrite
from support.runs.joints import fault, run_joints

from stepbus_orchestrator import cli
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.replay.branch_change import variants
from stepbus_schemas import WiringError


@pytest.fixture
def recorded(tmp_path):
    return run_joints(tmp_path, "duration=250ms", in_process=True).recording


def run_command(recorded, tmp_path, *words):
    out = ["--out", str(tmp_path / "b"), "--in-process", "--no-report"]
    return cli.main(["branch", str(recorded), *out, *words])


def test_an_unchanged_branch_is_equal_and_exits_with_0(recorded, tmp_path, capsys):
    assert run_command(recorded, tmp_path, "--at", "20") == 0
    printed = capsys.readouterr().out
    assert "live from step 20" in printed
    assert "50 steps, byte for byte as recorded" in printed


def test_a_branch_with_the_same_messages_exits_with_0_and_says_what_else_differs(
    recorded, tmp_path, capsys
):
    other = rewrite(recorded, tmp_path / "other.mcap", 4096, attached=["notes.txt"])
    assert run_command(other, tmp_path, "--at", "20", "--trust") == 0
    printed = capsys.readouterr().out
    assert "the files differ" in printed
    assert "notes.txt is only in the first" in printed


def test_a_branch_of_a_recording_that_is_cut_off_is_as_recorded_up_to_its_end(
    recorded, tmp_path, capsys
):
    whole = recorded.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: sum(chunks(whole)[0])])
    assert run_command(cut, tmp_path, "--at", "20", "--trust") == 0
    assert "all messages equal the recording" in capsys.readouterr().out


def test_a_branch_of_a_run_without_a_step_compares_nothing(tmp_path, capsys):
    broken = fault("controller", "raise", 0)
    failed = run_joints(tmp_path, broken, in_process=True).recording
    assert run_command(failed, tmp_path, "--at", "0") == ExitCode.FAULT
    assert "as recorded" not in capsys.readouterr().out


def test_a_change_shows_where_it_leaves_the_recording(recorded, tmp_path, capsys):
    assert run_command(recorded, tmp_path, "--at", "20", "--call", "plant put 0 1.5") == 0
    printed = capsys.readouterr().out
    assert "at step 20: plant/joint_state: position" in printed
    assert "  position: differs in " in printed
    assert "; largest difference " in printed


def test_json_has_the_result_and_nothing_else(recorded, tmp_path, capsys):
    assert run_command(recorded, tmp_path, "--at", "20", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["at"], found["equal"], found["changed"]) == (20, True, [])


def test_variants_lie_side_by_side_with_one_picture(recorded, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    programs = "controller.params={at: 1},{at: 2}"
    words = ["branch", str(recorded), "--at", "20", "--vary", programs, "--in-process"]
    out = tmp_path / "v"
    assert cli.main([*words, "--plot", "plant.joint_state.position[0]", "--out", str(out)]) == 0
    assert (out / "variants.png").stat().st_size > 10_000
    assert len(list(out.glob("*/run.mcap"))) == 2
    assert f"picture   {out / 'variants.png'}" in capsys.readouterr().out


def test_a_folder_that_is_in_use_is_refused(recorded, tmp_path, capsys):
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "notes").touch()
    words = ["--at", "2", "--vary", "controller.params.kp=1,2"]
    assert run_command(recorded, tmp_path, *words) == ExitCode.SCENARIO
    assert "is not empty" in capsys.readouterr().err


def test_variants_are_all_combinations():
    found = variants(["controller.params.kp=50,100", "plant.params.tip=[0, 1],[2, 3]"])
    assert list(found) == [
        "kp=50, tip=[0, 1]",
        "kp=50, tip=[2, 3]",
        "kp=100, tip=[0, 1]",
        "kp=100, tip=[2, 3]",
    ]
    assert found["kp=50, tip=[2, 3]"] == ["controller.params.kp=50", "plant.params.tip=[2, 3]"]


@pytest.mark.parametrize("text", ["kp", "kp=", "=1"])
def test_a_variation_without_values_is_refused(text):
    with pytest.raises(WiringError, match=r"write PATH=VALUE,VALUE…"):
        variants([text])
