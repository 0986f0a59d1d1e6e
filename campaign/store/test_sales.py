"""Runs sales and judges them."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from campaign import log_reader
from campaign.sandbox import STEPBUS

from .cases import Case, cases
from .judge import decoded, excuses, judge, largest_force

__all__ = ["cases"]
WHOLE = 80
_LONGEST_S = 1200.0
_PATIENCE = {"spawn_timeout": 120, "join_timeout": 60, "ready_timeout": 120, "step_timeout": 60}
"""Of every participant, so that the verdict does not depend on how fast the machine is [s]."""


@pytest.mark.timeout(2 * _LONGEST_S)
def test_sale_keeps_its_promises(
    case: Case, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """Sell, and judge the recording."""
    out = tmp_path / "run"
    done = sell(case, out)
    said, result = done.stderr + done.stdout, log_reader.result(out)
    if result is None or not (out / "run.mcap").exists():
        pytest.fail(f"no recording: {said[-300:]!r}", pytrace=False)
    recorded = log_reader.read(out / "run.mcap")
    log = decoded(recorded)
    excused = excuses(log, case.script)
    record_property("family", case.family)
    record_property("exit code", done.returncode)
    record_property("sold", done.returncode == 0)
    record_property("seconds", log.sold_after)
    record_property("largest force [N]", largest_force(log))
    record_property("unavoidable", excused.texts)
    record_property("hit", bool(excused.ran_into))
    if case.family.startswith("a post") and log.sold_after:
        sell(replace(case, script=[]), tmp_path / "undisturbed")
        alone = decoded(log_reader.read(tmp_path / "undisturbed" / "run.mcap"))
        record_property("of undisturbed", alone.sold_after and log.sold_after / alone.sold_after)
    broken = judge(log, result, case.killed, excused) + recorded.holes()
    if "Traceback (most recent call last)" in said:
        broken.append("a traceback is printed")
    if recorded.sha256 != result["sha256"]:
        broken.append("result.json gives another SHA-256 than the recording has")
    if broken:
        pytest.fail("\n".join([*broken, result["reason"]]), pytrace=False)


def sell(case: Case, out: Path) -> subprocess.CompletedProcess[str]:
    """Run a case; raises TimeoutExpired where it hangs."""
    names = ["plant", "perception", "mission", "controller", "planner"]
    names += ["world"] if case.scenario == "store" else []
    patience = [f"{name}.{key}={value}s" for name in names for key, value in _PATIENCE.items()]
    words = [word for item in patience for word in ("--set", item)]
    command = [STEPBUS, "run", *case.arguments(), *words, "--no-report", "--out", str(out)]
    return subprocess.run(command, capture_output=True, text=True, timeout=_LONGEST_S, check=False)
