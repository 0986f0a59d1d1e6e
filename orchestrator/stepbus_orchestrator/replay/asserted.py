"""Replay as an assertion, for any test framework."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from stepbus_orchestrator.analysis.tolerance import read_tolerance
from stepbus_schemas import StepbusError

from .execute import replay
from .result import ReplayResult


def assert_equal(
    recording: Path,
    participant: str,
    *,
    program: Sequence[str] | None = None,
    overrides: Sequence[str] = (),
    tolerance: Path | None = None,
) -> ReplayResult:
    """Replay a participant and return the result, as `replay` does; tolerance: a YAML file.

    Raises AssertionError, with the divergence or what went wrong, when it is not equal.
    """
    __tracebackhide__ = True
    try:
        result = replay(
            recording,
            participant,
            program=program,
            overrides=overrides,
            tolerance=None if tolerance is None else read_tolerance(tolerance),
        )
    except StepbusError as exc:
        # Its sentence says all; where it was raised is no place in the user's program.
        raise AssertionError(f"{recording}: {exc}") from None
    if not result.equal:
        raise AssertionError(f"{recording}: {result.text()}")
    return result
