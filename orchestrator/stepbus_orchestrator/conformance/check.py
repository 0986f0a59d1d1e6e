"""What a check is, and how checks run: an error in one stops no other."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from stepbus_orchestrator.errors import Interrupted

from .harness.kit import Kit
from .outcome import CheckResult, Failed, Outcome, Skipped


@dataclass(frozen=True, kw_only=True)
class Check:
    """One demand of the protocol.

    name: for `--only`. clause: of docs/protocol.md. summary: what it tries. run: returns what it
    observed; raises Failed or Skipped.
    """

    name: str
    clause: str
    summary: str
    run: Callable[[Kit], str]


def run_checks(
    kit: Kit, checks: Iterable[Check], on_result: Callable[[CheckResult], None]
) -> tuple[CheckResult, ...]:
    """Run checks one after the other; on_result: called with each result. Raises Interrupted."""
    results = []
    for check in checks:
        results.append(_run(kit, check))
        on_result(results[-1])
    return tuple(results)


def _run(kit: Kit, check: Check) -> CheckResult:
    kit.check = check.name
    began = time.monotonic()
    outcome, observed = _outcome(kit, check)
    return CheckResult(
        name=check.name,
        clause=check.clause,
        summary=check.summary,
        outcome=outcome,
        observed=observed,
        wall_s=time.monotonic() - began,
    )


def _outcome(kit: Kit, check: Check) -> tuple[Outcome, str]:
    try:
        return "pass", check.run(kit)
    except Failed as exc:
        return "fail", str(exc)
    except Skipped as exc:
        return "skipped", str(exc)
    except Interrupted:
        raise
    except Exception as exc:  # noqa: BLE001  (the other checks still run)
        return "fail", f"the check itself failed: {type(exc).__name__}: {exc}"
