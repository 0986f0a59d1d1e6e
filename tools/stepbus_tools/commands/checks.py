"""What is checked: `stepbus conformance` a program, `doctor` this machine, `selftest` a plant."""

import math
from collections.abc import Iterator, Sequence

from stepbus_orchestrator.cli.interrupts import interruptible
from stepbus_orchestrator.cli.terminal.live import displayed
from stepbus_orchestrator.cli.terminal.output import Answer, say, table
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.plugins import CHECKS, named_points
from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import PROTOCOL_VERSION, WiringError
from stepbus_tools.commands.declared import Conformance, Doctor, Selftest
from stepbus_tools.conformance import CheckResult, Report, conformance, select, write_junit
from stepbus_tools.doctor import Finding, examine
from stepbus_tools.selftest import SelfTest, Verdict, selftest


def conformance_command(given: Conformance) -> Answer:
    """Run the checks, and return whether the program passes."""
    if given.list:
        rows = [
            {"name": c.name, "clause": c.clause, "summary": c.summary} for c in select(given.only)
        ]
        row = "{name:20} {clause:6} {summary}"
        return Answer(value=rows, lines=[row.format(**r).replace("`", "") for r in rows])
    loaded, checks = load(given.scenario, given.set), select(given.only)
    with interruptible() as interrupt:
        report = conformance(
            loaded,
            given.participant,
            given.program,
            bridge=given.bridge,
            checks=checks,
            logs=given.logs,
            on_result=(lambda _result: None) if given.json else _show,
            interrupt=interrupt,
        )
    if given.junit is not None:
        write_junit(report, given.junit)
    return Answer(
        value={"conforms": report.conforms, "report": report},
        lines=[_verdict(report)],
        code=ExitCode.FINISHED if report.conforms else ExitCode.NONCONFORMING,
    )


def _show(result: CheckResult) -> None:
    """Print a result as it comes."""
    say(f"{result.outcome:8} {result.name} ({result.clause}): {result.observed}")


def _verdict(report: Report) -> str:
    return (
        f"{report.participant} {'conforms' if report.conforms else 'does not conform'} to protocol "
        f"{PROTOCOL_VERSION}: {report.count('pass')} passed, {report.count('fail')} failed, "
        f"{report.count('skipped')} skipped of {len(report.checks)} checks in {report.wall_s:.0f} s"
    )


def doctor_command(given: Doctor) -> Answer:
    """Examine this machine, or others; return the findings, with exit code 1 for a failure."""
    if given.listen and given.hosts is None:
        raise WiringError("--listen is for --hosts: which hosts are to reach this one?")
    if given.hosts is None:
        findings = examine()
    else:
        check = named_points(CHECKS)["ssh"].load()
        findings = [Finding(*row) for row in check(given.hosts, given.listen)]
    is_broken = any(finding.verdict == "fail" for finding in findings)
    width = max([18, *(len(finding.what) for finding in findings)])
    return Answer(
        value=findings,
        lines=[
            f"{finding.verdict:4}  {finding.what:{width}} {finding.text}" for finding in findings
        ],
        code=ExitCode.INTERNAL if is_broken else ExitCode.FINISHED,
    )


def selftest_command(given: Selftest) -> Answer:
    """Test every joint of a plant; return the verdicts, with exit code 11 if one fails."""
    loaded = load(given.scenario, given.set)
    title = f"{loaded.name} selftest"
    with displayed(title, quiet=given.json) as display, interruptible() as interrupt:
        result = selftest(loaded, math.radians(given.angle), display, interrupt)
    code = ExitCode.FINISHED if result.ok else ExitCode.NONCONFORMING
    return Answer(value=result, lines=_tested(result), code=code)


def _tested(result: SelfTest) -> Iterator[object]:
    made = table("joint", "mode", "commanded", "measured", "rad or m", "others", "verdict")
    for verdict in result.joints:
        made.add_row(verdict.joint, verdict.mode, *_cells(verdict))
    yield made
    wrong = [verdict.joint for verdict in result.joints if not verdict.ok]
    idle = [verdict.joint for verdict in result.joints if verdict.commanded is None]
    tested = len(result.joints) - len(idle)
    yield (
        f"{result.plant}: {tested - len(wrong)} of {tested} joints pass "
        f"({result.simulated_s:.1f} s simulated)"
        + (f"; without a motor: {', '.join(idle)}" if idle else "")
    )


def _cells(verdict: Verdict) -> Sequence[str]:
    if verdict.commanded is None or verdict.measured is None:
        return ["", "", "", "", "no motor"]
    findings = ["ok" if verdict.ok else "", *verdict.findings, verdict.other_side]
    return [
        verdict.shown(verdict.commanded),
        verdict.shown(verdict.measured),
        f"{verdict.measured:.4f}",
        "" if verdict.others is None else verdict.shown(verdict.others[1]),
        "; ".join(filter(None, findings)),
    ]
