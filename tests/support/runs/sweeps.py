"""Sweeps by the command line, and what they leave."""

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pyarrow.parquet as parquet

STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli"]


AXES = ["--vary", "controller.params.kp=50:200:3", "--vary", "controller.params.kd=10,20"]


SHORT = ["--set", "duration=100ms"]


def sweep(folder: Path, *words: str, check: bool = True) -> subprocess.CompletedProcess[str]:
    command = [*STEPBUS, "sweep", *words, "--out", str(folder / "sweep")]
    environment = {**os.environ, "HOME": str(folder)}
    done = subprocess.run(
        command,
        check=False,
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert not check or done.returncode == 0, done.stderr
    return done


def run_in(folder: Path, command: Sequence[str | Path]) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "HOME": str(folder)}
    return subprocess.run(
        command, check=False, cwd=folder, env=environment, capture_output=True, text=True
    )


def rows(folder: Path) -> dict[str, list[object]]:
    found: dict[str, list[object]] = parquet.read_table(
        folder / "sweep/results.parquet"
    ).to_pydict()
    return found


def wait_for(holds: object) -> None:
    assert callable(holds)
    end = time.monotonic() + 250
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.02)
