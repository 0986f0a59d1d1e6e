"""docs/comparison.md says what benchmarks/comparison/results.json has, and the task is one for all."""

import hashlib
import json
import os
import subprocess
import sys

import pytest
from benchmarks.comparison import page
from benchmarks.comparison.run import CHECKOUT, HERE


def test_the_tables_of_the_page_are_those_of_the_results():
    text = page.PAGE.read_text(encoding="utf-8")
    assert page.filled(text, page.tables(page.read_results())) == text, (
        "python -m benchmarks.comparison.page"
    )


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
