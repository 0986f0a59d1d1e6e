"""`stepbus info`: what is in a recording, also in one that was cut off or stands alone."""

import json
import os
import re
import shutil
import subprocess
import sys

import pytest
from support.runs.joints import write_scenario

from stepbus import run
from stepbus_orchestrator.cli import main
from stepbus_participant import installed_version


def info(path, capsys):
    assert main(["info", str(path)]) == 0
    name, rows = "", {}
    for line in capsys.readouterr().out.splitlines():
        name = line[:10].strip() or name
        rows.setdefault(name, []).append(line[10:])
    return rows


def test_a_run_is_ten_lines(two_link_recording, capsys):
    rows = info(two_link_recording.parent, capsys)
    assert sum(map(len, rows.values())) == 10
    assert rows["scenario"] == ["two_link"]
    assert rows["outcome"] == ["finished"]
    assert rows["length"][0].startswith("60 steps of 5 ms = 0.3 s, in ")
    assert rows["programs"][0].startswith("plant (Python stepbus_plant:Plant), controller (Python ")
    assert rows["messages"][0] == "241 of 4 ports, 803/s"
    assert rows["types"][0].startswith("61 JointState/1 (plant/joint_state), ")
    assert rows["events"] == ["none; faults injected: none"]
    own = re.escape(installed_version("stepbus"))
    assert re.search(rf", stepbus {own}, \d+ libraries \(--json\), ", rows["versions"][0])
    assert len(rows["hash"][0]) == 64


def test_a_recording_alone_says_that_it_is_complete(two_link_recording, tmp_path, capsys):
    shutil.copy(two_link_recording, tmp_path / "alone.mcap")
    rows = info(tmp_path / "alone.mcap", capsys)
    assert "outcome unknown without its result.json" in rows["outcome"][0]
    assert rows["length"] == ["60 steps of 5 ms = 0.3 s"]
    assert "folder" not in rows["recording"][0]


def test_the_result_of_another_run_is_not_taken_for_its_own(two_link_recording, tmp_path, capsys):
    shutil.copy(two_link_recording, tmp_path)
    result = json.loads((two_link_recording.parent / "result.json").read_text())
    other = json.dumps({**result, "messages_sha256": "0" * 64, "outcome": "failed"})
    (tmp_path / "result.json").write_text(other)
    assert "without its result.json" in info(tmp_path, capsys)["outcome"][0]


def test_one_that_was_cut_off_says_so_and_how_far_it_goes(tmp_path, capsys):
    done = run("two_link", set={"duration": "2s"}, in_process=True, out=tmp_path / "out")
    whole = done.recording.read_bytes()
    done.recording.write_bytes(whole[: len(whole) // 2])
    rows = info(tmp_path / "out", capsys)
    assert rows["outcome"][0].startswith("cut short: it is damaged: ")
    steps = int(rows["length"][0].split(" of 400 steps of 5 ms")[0])
    assert 0 < steps < 400
    assert f"{steps} JointCommand/1 (controller/command)" in rows["types"][0]
    assert "does not cover the last step" in rows["hash"][0]


def test_a_run_that_failed_has_its_reason_its_faults_and_its_length(tmp_path, capsys):
    path = write_scenario(tmp_path / "source")
    words = ["run", str(path), "--no-report", "--out", str(tmp_path / "out")]
    assert main([*words, "--fault", "kill controller at 5"]) == 5
    reason = capsys.readouterr().err.splitlines()[0].removeprefix("stepbus: ")
    rows = info(tmp_path / "out", capsys)
    assert rows["outcome"][0].startswith("failed: ")
    assert reason in rows["outcome"][0]
    assert "; missing outputs: " in rows["outcome"][0]
    assert rows["events"][0].endswith("faults injected: kill controller at 5")
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert rows["length"][0].startswith(f"{result['steps']} of ")
    (tmp_path / "out" / "result.json").unlink()
    assert info(tmp_path / "out", capsys)["length"][0].startswith(f"{result['steps']} of ")


def test_a_pipe_in_the_place_of_the_result_holds_nothing(two_link_recording, tmp_path):
    shutil.copy(two_link_recording, tmp_path)
    os.mkfifo(tmp_path / "result.json")
    command = [sys.executable, "-m", "stepbus_orchestrator.cli", "info", tmp_path]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert (done.returncode, "without its result.json" in done.stdout) == (0, True)


def test_json_has_the_same_and_more(two_link_recording, capsys):
    assert main(["info", str(two_link_recording), "--json"]) == 0
    value = json.loads(capsys.readouterr().out)
    assert (value["steps"], value["planned_steps"], value["step_ns"]) == (60, 60, 5_000_000)
    assert value["duration_s"] == pytest.approx(0.3)
    assert {row["type"]: row["messages"] for row in value["ports"]}["JointCommand/1"] == 60
    assert value["versions"]["orchestrator"]["stepbus"] == installed_version("stepbus")
