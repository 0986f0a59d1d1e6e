"""Sweeps that are struck: killed, interrupted, without disk or node, beside other users."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import Popen

import psutil
import pyarrow.parquet as parquet
import pytest
from support.runs.sweeps import SHORT, STEPBUS, rows, run_in, sweep, wait_for
from support.surroundings import listening

from stepbus_orchestrator.errors import ExitCode

pytestmark = pytest.mark.timeout(600)


@pytest.mark.slow
def test_a_sweep_that_is_killed_goes_on_and_gives_the_same_table(tmp_path: Path) -> None:
    words = ["two_link", *SHORT, "--vary", "controller.params.kp~uniform(50, 100)"]
    words += ["--samples", "40", "--seed", "3"]
    (tmp_path / "whole").mkdir()
    sweep(tmp_path / "whole", *words, "--jobs", "1")
    command = [*STEPBUS, "sweep", *words, "--out", str(tmp_path / "sweep")]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=tmp_path) as process:
        family = psutil.Process(process.pid)
        journal = tmp_path / "sweep/rows.jsonl"
        wait_for(lambda: journal.exists() and journal.read_bytes().count(b"\n") >= 5)
        children = family.children(recursive=True)
        process.send_signal(signal.SIGKILL)
    _, alive = psutil.wait_procs(children, timeout=100)
    assert not alive
    before = {json.loads(line)["run"] for line in journal.read_bytes().splitlines(keepends=True)
              if line.endswith(b"\n")}  # fmt: skip
    done = sweep(tmp_path, *words)
    assert f"{len(before)} resumed" in done.stdout
    names = ("whole/sweep/results.parquet", "sweep/results.parquet")
    assert len({(tmp_path / name).read_bytes() for name in names}) == 1


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_done(tmp_path: Path) -> None:
    command = [*STEPBUS, "sweep", "two_link", "--vary", "controller.params.kp=50:100:400"]
    command += [*SHORT, "--out", str(tmp_path / "sweep")]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        journal = tmp_path / "sweep/rows.jsonl"
        wait_for(lambda: journal.exists() and journal.read_bytes().count(b"\n") >= 3)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=200)
    assert process.returncode == 130
    assert "of 400 runs; run the same command" in errors
    assert 3 <= len(rows(tmp_path)["run"]) < 400


@pytest.mark.slow
@pytest.mark.parametrize("keep", ["all", "none"])
def test_a_full_disk_ends_a_sweep_and_leaves_no_row_that_is_not_the_points_own(
    tmp_path: Path, small_disk: Callable[[str], Path], keep: str
) -> None:
    disk = small_disk("16m")
    filler = disk / "filler"
    left = 1_200_000 if keep == "all" else 40_000
    filler.write_bytes(bytes(16 * 1024**2 - left))
    words = ["two_link", "--set", "duration=5s", "--vary", "controller.params.kp=50:100:8"]
    command = [*STEPBUS, "sweep", *words, "--keep", keep, "--out", disk / "sweep"]
    done = run_in(tmp_path, command)
    assert done.returncode == ExitCode.RECORDING, done.stderr
    assert "No space left on device" in done.stderr
    journal = (disk / "sweep/rows.jsonl").read_bytes().splitlines()
    assert all(json.loads(line)["exit_code"] == 0 for line in journal)
    filler.unlink()
    done = run_in(tmp_path, command)
    assert done.returncode == 0, done.stderr
    table = parquet.read_table(disk / "sweep/results.parquet").to_pydict()
    assert table["exit_code"] == [0] * 8


@pytest.mark.slow
def test_with_a_umask_of_0_nobody_else_may_write_to_what_a_sweep_leaves(tmp_path: Path) -> None:
    words = ["two_link", *SHORT, "--vary", "controller.params.kp=50,100", "--keep", "all"]
    command = [*STEPBUS, "sweep", *words, "--out", str(tmp_path / "sweep")]
    environment = {**os.environ, "HOME": str(tmp_path)}
    subprocess.run(command, check=True, cwd=tmp_path, env=environment, umask=0, capture_output=True)
    found = [tmp_path / "sweep", *(tmp_path / "sweep").rglob("*")]
    assert len(found) > 20
    assert [str(path) for path in found if path.stat().st_mode & 0o002] == []


@pytest.mark.slow
def test_a_node_that_dies_costs_only_its_runs(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    words = ["two_link", *SHORT, "--vary", "controller.params.kp=50:100:60"]
    (tmp_path / "whole").mkdir()
    sweep(tmp_path / "whole", *words, "--jobs", "1")
    script = Path(__file__).parent / "programs" / "losing_a_node.py"
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path / "sweep"), *words[1:]],
        check=False, cwd=tmp_path, capture_output=True, text=True, timeout=280,
        env={**os.environ, "HOME": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    names = ("whole/sweep/results.parquet", "sweep/results.parquet")
    assert len({(tmp_path / name).read_bytes() for name in names}) == 1


def test_a_sweep_opens_no_port_and_leaves_nothing_to_other_users(tmp_path: Path) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    with running(tmp_path, "--jobs", "1", TMPDIR=str(temporary)) as (process, _):
        family = [psutil.Process(process.pid), *psutil.Process(process.pid).children(True)]
        assert len(family) > 1
        assert listening(family) == set()
        modes = {path.name: path.stat().st_mode & 0o777 for path in temporary.iterdir()}
        assert modes
        assert set(modes.values()) == {0o700}
        process.send_signal(signal.SIGINT)
        process.wait(60)
    assert list(temporary.iterdir()) == []


def test_a_sweep_whose_process_is_killed_leaves_no_process_and_no_folder(tmp_path: Path) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    with running(tmp_path, TMPDIR=str(temporary)) as (process, _):
        family = psutil.Process(process.pid).children(recursive=True)
        process.kill()
    _, alive = psutil.wait_procs(family, timeout=60)
    assert not alive
    assert list(temporary.iterdir()) == []


def test_a_fork_server_that_ends_is_named(tmp_path: Path) -> None:
    with running(tmp_path) as (process, errors):
        (server,) = psutil.Process(process.pid).children()
        server.kill()
        assert process.wait(60) == ExitCode.START
    assert f"process {server.pid}, which starts the runs, has ended" in errors.read_text()


def test_a_run_whose_process_dies_is_made_again(tmp_path: Path) -> None:
    with running(tmp_path, "--set", "duration=20s", "--jobs", "1") as (process, _):
        (server,) = psutil.Process(process.pid).children()
        before = server.children()
        wait_for(lambda: [child for child in server.children() if child not in before])
        next(child for child in server.children() if child not in before).kill()
        wait_for(lambda: len(journal_of(tmp_path)) >= 3)
        process.send_signal(signal.SIGINT)
        process.wait(60)
    lines = journal_of(tmp_path)
    assert {line["exit_code"] for line in lines} == {0}
    assert sum(line["attempts"] for line in lines) == len(lines) + 1


def journal_of(folder: Path) -> list[dict[str, int]]:
    lines = (folder / "sweep/rows.jsonl").read_bytes().splitlines(keepends=True)
    return [json.loads(line) for line in lines if line.endswith(b"\n")]


@contextlib.contextmanager
def running(folder: Path, *words: str, **variables: str) -> Iterator[tuple[Popen[bytes], Path]]:
    """Yield a sweep of two_link with a finished run, and the file of its errors; then kill it."""
    command = [*STEPBUS, "sweep", "two_link", "--vary", "controller.params.kp=50:100:400"]
    errors, journal = folder / "errors", folder / "sweep/rows.jsonl"
    with (
        errors.open("wb") as sink,
        Popen(
            [*command, *words, "--out", str(folder / "sweep")],
            stdout=subprocess.DEVNULL,
            stderr=sink,
            env={**os.environ, **variables},
        ) as process,
    ):
        try:
            wait_for(lambda: journal.exists() and journal.stat().st_size > 0)
            yield process, errors
        finally:
            process.kill()


def test_ctrl_c_ends_a_sweep_whose_metric_hangs_when_it_is_imported(tmp_path: Path) -> None:
    (tmp_path / "temporary").mkdir()
    (tmp_path / "my.py").write_text(
        "import pathlib, time\n"
        f"pathlib.Path({str(tmp_path / 'waits')!r}).touch()\n"
        "time.sleep(1000)\n\n\ndef mine(recording):\n    return {}\n"
    )
    words = ["sweep", "two_link", "--vary", "seed=1,2", "--metric", "my.py:mine", "--out", "sweep"]
    environment = {**os.environ, "TMPDIR": str(tmp_path / "temporary")}
    with Popen(
        [*STEPBUS, *words], cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True
    ) as process:
        wait_for((tmp_path / "waits").exists)
        family = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted before the first run" in errors
    _, alive = psutil.wait_procs(family, timeout=10)
    assert not alive
    assert list((tmp_path / "temporary").iterdir()) == []
