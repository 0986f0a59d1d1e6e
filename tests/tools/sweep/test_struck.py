"""Sweeps that are struck: killed, interrupted, without disk or node, beside other users."""

import contextlib
import itertools
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import psutil
import pyarrow.parquet as parquet
import pytest
from support.runs.sweeps import SHORT, STEPBUS, rows, run_in, sweep, wait_for
from support.surroundings import answers, listening

from stepbus_orchestrator.errors import ExitCode

pytest.importorskip("ray")
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


@pytest.mark.slow
def test_other_users_of_the_machine_get_nothing_of_a_sweep(tmp_path: Path) -> None:
    words = [*STEPBUS, "sweep", "two_link", "--vary", "controller.params.kp=50:100:200"]
    journal, temporary = tmp_path / "sweep/rows.jsonl", Path(tempfile.mkdtemp(prefix="s-"))
    environment = {**os.environ, "HOME": str(tmp_path), "TMPDIR": str(temporary)}
    answer = "refused: nobody but root can try"
    temporary.chmod(0o755)
    with subprocess.Popen(
        [*words, "--jobs", "1", "--out", str(tmp_path / "sweep")],
        cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        try:
            wait_for(lambda: journal.exists() and journal.stat().st_size > 0)
            family = [psutil.Process(process.pid), *psutil.Process(process.pid).children(True)]
            addresses = listening(family)
            settings = answers(family, psutil.Process.environ).values()
            secrets = {variables.get("RAY_AUTH_TOKEN", "") for variables in settings} - {""}
            said = " ".join(itertools.chain(*answers(family, psutil.Process.cmdline).values()))
            (private,) = temporary.glob("stepbus-ray-*")
            mode = private.stat().st_mode & 0o777
            if os.getuid() == 0:  # only root can become another user
                for attempt in (["ls", private], ["ls", private / "r"]):
                    assert subprocess.run(attempt, user=65534, check=False).returncode != 0
                (address,) = {
                    word.partition("=")[2] for word in said.split() if "--gcs-address=" in word
                }
                # Ray replaces 127.0.0.1 by the machine's own address, where nothing listens.
                answer = as_another_user(
                    tmp_path, f"[::ffff:127.0.0.1]:{address.rpartition(':')[2]}"
                )
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(60)
    assert addresses == {"127.0.0.1"}
    assert answer.startswith("refused"), answer
    assert mode == 0o700
    (secret,) = secrets
    assert secret not in said
    assert not private.exists()
    assert list(temporary.iterdir()) == []
    temporary.rmdir()


CLIENT = """
import sys, ray
try:
    ray.init(address=sys.argv[1], log_to_driver=False)
    print("ran as", ray.get(ray.remote(__import__("os").getuid).remote(), timeout=60))
except Exception as exc:
    print("refused", exc)
"""


def as_another_user(folder: Path, address: str) -> str:
    """Return what a Ray client of another user gets, with a token that it has guessed."""
    minor = f"python3.{sys.version_info.minor}"
    packages = str(Path(psutil.__file__).parents[1])
    guessed = {"HOME": str(folder), "PYTHONPATH": packages, "RAY_AUTH_MODE": "token",
               "RAY_AUTH_TOKEN": "a" * 32}  # fmt: skip
    for python in (sys.executable, f"/usr/bin/{minor}"):
        with contextlib.suppress(PermissionError, FileNotFoundError):
            done = subprocess.run(
                [python, "-c", CLIENT, address], user=65534, group=65534, extra_groups=[],
                env=guessed, capture_output=True, text=True, timeout=200, check=False, cwd="/",
            )  # fmt: skip
            return done.stdout.strip() or done.stderr
    return "refused: it has no Python that it may start"
