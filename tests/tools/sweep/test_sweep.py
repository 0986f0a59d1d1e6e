"""Sweeps as a user makes them: by the command line."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as parquet
import pytest
from support.runs.sweeps import AXES, SHORT, STEPBUS, rows, run_in, sweep

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode

pytestmark = pytest.mark.timeout(600)

METRIC = """
import helper

def worst(recording):
    return {"worst": helper.largest(recording["plant.joint_state"].position)}

def broken(recording):
    raise ValueError("no data")
"""


@pytest.mark.slow
def test_a_sweep_is_a_table_a_page_and_runs_that_can_be_made_again(tmp_path: Path) -> None:
    (tmp_path / "my.py").write_text(METRIC)
    (tmp_path / "helper.py").write_text("def largest(values):\n    return abs(values).max()\n")
    words = ["two_link", *AXES, *SHORT, "--jobs", "1", "--keep", "all"]
    metrics = ["--metric", "my.py:worst", "--metric", "my.py:broken"]
    done = sweep(tmp_path, *words, *metrics, "--vary", "faults=none,kill controller at 5")
    assert "6 of 12 failed" in done.stdout
    told = re.findall(r"^sweep: .*$", done.stdout, re.MULTILINE)
    form = r"sweep: \d+ of 12 runs[^%]*, \d+ %(, [0-9.]+ (runs/s|s/run))?(, .+ left)?(; .+)?"
    assert all(re.fullmatch(form, line) for line in told), told
    assert "0.0 runs/s" not in done.stdout
    table = rows(tmp_path)
    assert table["run"] == list(range(12))
    assert table["controller.params.kp"] == [50] * 4 + [125] * 4 + [200] * 4
    assert table["exit_code"] == [0, 5] * 6
    assert table["success"] == [True, False] * 6
    assert all(table["worst"])
    assert "my.py:broken raised ValueError: no data" in str(table["metric_error"][0])
    assert len(set(table["sha256"][::2])) == 6
    # What stays is a recording like any other, and row 4 again is the same, in processes.
    kept = tmp_path / "sweep" / str(table["folder"][4])
    assert (kept / "run.mcap").is_file()
    again = [*STEPBUS, "rerun", str(tmp_path / "sweep"), "4", "--out", str(tmp_path / "again")]
    found = subprocess.run(
        [*again, "--json"], check=False, capture_output=True, text=True, timeout=60
    )
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout)["result"]["sha256"] == table["sha256"][4]
    subprocess.run([*again[:-1], str(tmp_path / "shown")], check=True, timeout=60)
    assert (tmp_path / "shown/report.html").is_file()
    page = (tmp_path / "sweep/report.html").read_text()
    assert "kill controller at 5" in page
    assert '<span class="verdict failed">6 of 12 failed</span>' in page
    assert page.index("Failures by cause") < page.index("Against each axis")
    assert str(tmp_path) not in page
    # The same command has nothing to do; another sweep gets no place here.
    before = (tmp_path / "sweep/results.parquet").read_bytes()
    more = sweep(tmp_path, *words, *metrics, "--vary", "faults=none,kill controller at 5")
    assert "0 runs" in more.stdout
    assert "12 resumed" in more.stdout
    assert (tmp_path / "sweep/results.parquet").read_bytes() == before
    other = sweep(tmp_path, "two_link", *AXES, check=False)
    assert other.returncode == 2
    assert "contains another sweep" in other.stderr


@pytest.mark.parametrize(
    ("words", "sentences"),
    [
        (
            ["--vary", "controller.params.kpp=1,2", "--vary", "controller.params.kp=x"],
            ["did you mean 'kp'?", "must be a number of at least 0, a list or a map, not 'x'"],
        ),
        (["--vary", "plant.params.gravity~normal(1, -1)"], ["does not accept these parameters"]),
        ([], ["needs at least one axis"]),
        (["--vary", "seed=1,2", "--metric", "no.py"], ["write FILE.py:FUNCTION"]),
        (["--vary", "seed=1,2", "--optimize", "rmse"], ["an optimizer needs a number of runs"]),
        (
            ["--vary", "controller.params.kp=1:5", "--optimize", "rmsee", "--trials", "4"],
            ["rmsee: unknown metric", "your own: --metric", "did you mean 'rmse'?"],
        ),
        (
            [
                *("--vary", "controller.params.kp=1:5", "--vary", "controler.params.kd=1,2"),
                *("--vary", "plant.params.world~nrmal(1, 2)", "--set", "durtion=1s"),
                *("--metric", "no.py:f", "--repeats", "many", "--sampling", "latn"),
            ],
            [
                "vary[0]: controller.params.kp=1:5: a range needs a count",
                "vary[1]: controler.params.kd=1,2: no participant or key 'controler'; did you",
                "SciPy has no distribution 'nrmal'; did you mean 'normal'?",
                "--set durtion=1s: no participant or key 'durtion'; did you mean 'duration'?",
                "metrics[0]: no.py:f: no file no.py",
                "repeats: must be an integer of at least 1, not 'many'",
                "sampling: must be random, latin, sobol or halton, not 'latn'; did you mean",
            ],
        ),
        (
            ["--vary", "seed=1,2", "--batch", "3", "--sampling", "sobol", "--maximize"],
            [
                "batch: is only for an optimizer",
                "sampling: no axis has",
                "optimize: needs the name",
            ],
        ),
        (
            [
                *("--vary", "controller.params.kp=1:5", "--optimize", "rmsee"),
                *("--trials", "3", "--repeats", "2", "--samples", "5"),
            ],
            [
                "optimize: rmsee: unknown metric",
                "repeats: the optimizer chooses",
                "samples: the optimizer chooses",
            ],
        ),
    ],
)
def test_a_mistake_is_one_sentence_before_anything_starts(
    tmp_path: Path,
    words: list[str],
    sentences: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["sweep", "two_link", *words, "--out", "sweep"]) == ExitCode.SCENARIO == 2
    errors = " ".join(capsys.readouterr().err.split())
    assert "Traceback" not in errors
    assert all(sentence in errors for sentence in sentences), errors
    assert not (tmp_path / "sweep/rows.jsonl").exists()


def test_all_mistakes_of_a_sweep_file_are_listed_with_their_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text("def measure(recording):\n    return 1.0\n")
    Path("sweep.yaml").write_text(
        "scenario: two_lnk\nvary: [controller.params.kp=50:200]\nsampels: 3\nrepeats: x\n"
        "metrics: ['mine.py:mesure', 'mine.py:measure']\n"
    )
    assert main(["sweep", "sweep.yaml", "--trials", "3"]) == ExitCode.SCENARIO
    errors = capsys.readouterr().err
    for sentence in (
        "optimize: needs the name of a metric, as trials are for an optimizer",
        "sweep.yaml:2: vary[0]: controller.params.kp=50:200: a range needs a count",
        "sweep.yaml:3: sampels: unknown key 'sampels'; did you mean 'samples'?",
        "sweep.yaml:4: repeats: must be an integer of at least 1, not 'x'",
        "sweep.yaml:5: metrics[0]: mine.py:mesure: mine.py has no function 'mesure'",
        "two_lnk: no such file, folder or built-in scenario",
    ):
        assert sentence in errors
    assert "metrics[1]" not in errors


@pytest.mark.slow
def test_an_optimizer_asks_for_the_same_points_however_many_cores(tmp_path: Path) -> None:
    words = ["two_link", "--set", "duration=500ms", "--vary", "controller.params.kp=10:400:log"]
    words += ["--vary", "controller.params.kd=1:60", "--optimize", "rmse", "--trials", "16"]
    for jobs in ("1", "2"):
        (tmp_path / jobs).mkdir()
        done = sweep(tmp_path / jobs, *words, "--jobs", jobs)
    tables = [(tmp_path / jobs / "sweep/results.parquet").read_bytes() for jobs in ("1", "2")]
    assert tables[0] == tables[1]
    table = rows(tmp_path / "1")
    found = table["rmse"]
    best = min(range(16), key=found.__getitem__)
    gains = ", ".join(
        f"{p}={table[p][best]}" for p in ("controller.params.kp", "controller.params.kd")
    )
    assert f"best   run {best}: rmse {found[best]}, {gains}\n" in done.stdout
    assert min(found[8:]) < min(found[:4])


TIP = """
def measure(recording):
    return {"tip_error": 0.5, "verdict": "fine"}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("tip_eror", "it is a number in no run; did you mean 'tip_error'?"),
        ("settling", "it is a number in no run; they have"),
    ],
)
def test_an_optimizer_ends_where_there_is_nothing_to_optimise(
    tmp_path: Path, name: str, sentence: str
) -> None:
    (tmp_path / "measure.py").write_text(TIP)
    words = ["two_link", *SHORT, "--vary", "controller.params.kp=10:400", "--trials", "32"]
    words += ["--optimize", name, "--metric", "measure.py:measure", "--out", "sweep"]
    command = [*STEPBUS, "sweep", *words]
    done = run_in(tmp_path, command)
    assert done.returncode == 2
    assert " ".join(sentence.split()) in " ".join(done.stderr.split())
    assert 0 < (tmp_path / "sweep/rows.jsonl").read_bytes().count(b"\n") < 32


@pytest.mark.slow
def test_a_run_that_takes_too_long_is_a_row(tmp_path: Path) -> None:
    words = ["two_link", "--vary", "duration=100ms,2000s", "--timeout", "20s", "--jobs", "2"]
    sweep(tmp_path, *words)
    table = rows(tmp_path)
    assert table["outcome"] == ["finished", "timed out"]
    assert table["reason"][1] == "it exceeded the limit of 20 s"


FLAKY = """
import os, pathlib, stepbus

class Flaky(stepbus.Participant):
    def start(self, inputs):
        mark = pathlib.Path(self.config.param("mark") + str(self.config.param("number")))
        if self.config.param("number") and not mark.exists():
            mark.touch()
            os._exit(3)

raise SystemExit(stepbus.main(Flaky))
"""


@pytest.mark.slow
def test_what_a_machine_may_have_failed_is_repeated_and_values_vary_together(
    tmp_path: Path,
) -> None:
    (tmp_path / "flaky.py").write_text(FLAKY)
    (tmp_path / "s.yaml").write_text(
        "extends: two_link\nname: flaky\nduration: 50ms\nparticipants:\n  flaky:\n"
        "    exec: [python, flaky.py]\n    inputs: {joint_state: plant.joint_state}\n"
        f"    params: {{mark: {tmp_path}/mark, number: 0}}\n"
    )
    axis = "flaky.params.number=0,1,2 & controller.params.kp=50,60,70"
    words = ["s.yaml", "--vary", axis, "--jobs", "1", "--keep", "none"]
    sweep(tmp_path, *words, "--retry", "1")
    table = rows(tmp_path)
    assert table["exit_code"] == [0, 0, 0]
    assert table["controller.params.kp"] == [50, 60, 70]
    times = parquet.read_table(tmp_path / "sweep/times.parquet").to_pydict()
    assert times["attempts"] == [1, 2, 2]
    # Without, they are rows with their cause; and Python has the same sweep.
    for mark in tmp_path.glob("mark*"):
        mark.unlink()
    text = (
        "import stepbus; "
        f"done = stepbus.sweep('s.yaml', [{axis!r}], jobs=1, keep='none', out='plain'); "
        "print(done.failed, dict(done.causes), done.table()['exit_code'].to_pylist())"
    )
    found = subprocess.run(
        [sys.executable, "-c", text], cwd=tmp_path, capture_output=True, text=True, timeout=100,
        check=False, env={**os.environ, "HOME": str(tmp_path)},
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    cause = {"failed (flaky), exit code 5": 2}
    assert found.stdout.strip() == f"2 {cause} [0, 5, 5]", found.stdout


THREADED = """
import threading

threading.Thread(target=threading.Event().wait, daemon=True).start()

def threads(recording):
    return {"threads": threading.active_count()}
"""


def test_a_metric_that_starts_a_thread_is_loaded_by_each_run(tmp_path: Path) -> None:
    (tmp_path / "my.py").write_text(THREADED)
    words = ["two_link", *SHORT, "--vary", "controller.params.kp=50,100"]
    sweep(tmp_path, *words, "--metric", "my.py:threads")
    assert rows(tmp_path)["threads"] == [2, 2]
