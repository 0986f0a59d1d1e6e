"""What a check is, and how checks run: an error in one stops no other."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from stepbus_orchestrator.errors import Interrupted
from stepbus_schemas import error_text
from stepbus_tools.conformance.kit import Kit
from stepbus_tools.conformance.outcome import CheckResult, Failed, Outcome, Skipped

Run = Callable[[Kit], str]


@dataclass(frozen=True, kw_only=True)
class Check:
    """One demand of the protocol.

    name: for `--only`. clause: of docs/protocol.md. summary: what is demanded. run: returns what
    it observed; raises Failed or Skipped. inputs, plain: whether it is skipped for a participant
    without inputs, or without a plain run to compare with.
    """

    name: str
    clause: str
    summary: str
    run: Run
    inputs: bool = False
    plain: bool = False


def check(
    clause: str, summary: str, *, inputs: bool = False, plain: bool = False
) -> Callable[[Run], Check]:
    """Make a function a `Check`, which has its name."""

    def make(run: Run) -> Check:
        name = run.__name__.strip("_").replace("_", "-")
        return Check(name=name, clause=clause, summary=summary, run=run, inputs=inputs, plain=plain)

    return make


def run_checks(
    kit: Kit, checks: Iterable[Check], on_result: Callable[[CheckResult], None]
) -> tuple[CheckResult, ...]:
    """Run checks one after the other; on_result: called with each result. Raises Interrupted."""
    results = []
    for each in checks:
        kit.check = each.name
        began = time.monotonic()
        outcome, observed = _outcome(kit, each)
        result = CheckResult(
            name=each.name,
            clause=each.clause,
            summary=each.summary,
            outcome=outcome,
            observed=observed,
            wall_s=time.monotonic() - began,
        )
        results.append(result)
        on_result(result)
    return tuple(results)


def _outcome(kit: Kit, each: Check) -> tuple[Outcome, str]:
    try:
        if each.inputs and not kit.spec.inputs:
            return "skipped", "it has no inputs"
        if each.plain:
            kit.reference()
        return "pass", each.run(kit)
    except Failed as exc:
        return "fail", str(exc)
    except Skipped as exc:
        return "skipped", str(exc)
    except Interrupted:
        raise
    except Exception as exc:  # noqa: BLE001  (the other checks still run)
        return "fail", f"the check itself failed: {error_text(exc)}"
