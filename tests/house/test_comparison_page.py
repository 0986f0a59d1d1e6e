"""docs/comparison.md says what benchmarks/comparison/results.json has, and the task is one for all."""

import hashlib
import json
import os
import re
import subprocess
import sys

import pytest
from benchmarks.comparison import page, processes
from benchmarks.comparison.lines import count_lines
from benchmarks.comparison.tools import CHECKOUT, HERE, TOOLS


def test_the_tables_of_the_page_are_those_of_the_results():
    text = page.PAGE.read_text(encoding="utf-8")
    assert page.filled(text, page.read_results()) == text, "python -m benchmarks.comparison.page"


def test_a_page_without_a_place_for_a_table_is_refused():
    with pytest.raises(ValueError, match="needs one '<!-- measured: conditions -->'"):
        page.filled("nothing", page.read_results())


def test_every_tool_is_measured_and_its_files_are_those_that_were_counted():
    tools = page.read_results()["tools"]
    assert list(tools) == list(page.NAMES)
    for tool in TOOLS:
        files = tool.code + tool.record
        now = {name: count_lines(HERE / tool.name / name) for name in files}
        assert tools[tool.name]["lines"] == now, f"make comparison: {tool.name} has changed"
        assert set(tools[tool.name]["versions"]) == set(tool.shows)


def test_what_the_page_says_of_replays_is_so():
    tools = page.read_results()["tools"]
    assert tools["stepbus"]["replay_says"][0] == "controller: equal to the recording over 400 steps"
    assert tools["helics"]["replay_difference"] <= 2e-14
    assert tools["pybullet_gymnasium"]["loop_difference"] <= 2e-7
    rows, difference = re.findall(
        r"(\d+) rows, largest difference (\S+)", tools["fmi"]["replay_says"][-1]
    )[0]
    assert int(rows) == 401
    assert float(difference) <= 1e-4


def test_the_plain_loop_gives_the_trace_of_the_results(tmp_path):
    command = [sys.executable, str(HERE / "shared/arm.py")]
    subprocess.run(
        command, check=True, timeout=60, env={**os.environ, "COMPARISON_OUT": str(tmp_path)}
    )
    trace = (tmp_path / "trace.txt").read_bytes()
    assert trace.count(b"\n") == 400
    assert (
        hashlib.sha256(trace).hexdigest() == json.loads((HERE / "results.json").read_text())["loop"]
    )


def test_lines_of_code_are_neither_blank_nor_comments_nor_docstrings(tmp_path):
    file = tmp_path / "some.py"
    file.write_text(
        '"""Doc\n\nstring."""\n\n# why\nx = """a\nb"""\n\n\ndef f():\n    """Doc."""\n    g(\n        x\n    )\n'
    )
    assert count_lines(file) == 6
    other = tmp_path / "some.yaml"
    other.write_text("# why\n\na: 1\nb: 2\n")
    assert count_lines(other) == 2


def test_a_stalled_controller_is_struck_and_what_it_leaves_is_found_and_killed(tmp_path):
    child = "import time; time.sleep(600)"
    program = (
        "import os, pathlib, subprocess, sys, time\n"
        f"subprocess.Popen([sys.executable, '-c', {child!r}], start_new_session=True)\n"
        "stalled = pathlib.Path('stalled.new'); stalled.write_text(str(os.getpid()))\n"
        "stalled.rename('stalled'); time.sleep(600)\n"
    )
    mark = f"test-{os.getpid()}"
    environment = {**os.environ, processes.MARK: mark}
    command = [sys.executable, "-c", program]
    process = processes.start(command, tmp_path, environment, tmp_path / "log")
    found = processes.strike(
        process, tmp_path / "stalled", mark, kill=True, log=tmp_path / "log", clean_s=0
    )
    assert (found["ended"], found["exit_code"]) == ("by itself", -9)
    assert len(found["left"]) == len(found["left_later"]) == 1
    assert processes.alive(mark) == {}


@pytest.mark.slow
def test_the_task_runs_in_stepbus_as_the_results_say(tmp_path):
    module = [sys.executable, "-m", "benchmarks.comparison.run"]
    where = ["--out", str(tmp_path), "--results", str(tmp_path / "results.json")]
    command = [*module, "--only", "stepbus", "--runs", "2", *where]
    subprocess.run(command, check=True, cwd=CHECKOUT, timeout=500)
    now = json.loads((tmp_path / "results.json").read_text())["tools"]["stepbus"]
    published = page.read_results()
    assert set(now["traces"]) == {published["loop"]}
    assert len(set(now["recordings"])) == 1
    for kind in ("kill", "sleep"):
        then = published["tools"]["stepbus"][kind]
        for key in ("ended", "exit_code", "left", "plant_steps"):
            assert now[kind][key] == then[key]
