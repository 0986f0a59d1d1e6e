"""What is checked: `stepbus conformance` a program, `doctor` this machine, `selftest` a plant."""

import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from stepbus_orchestrator.cli.parameters import Json, ScenarioName, Set, command
from stepbus_orchestrator.cli.signals import interruptible
from stepbus_orchestrator.cli.terminal.live import displayed
from stepbus_orchestrator.cli.terminal.output import Answer, has_screen, say, table, visible
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import PROTOCOL_VERSION, BridgeFormat
from stepbus_tools.conformance import CheckResult, Report, conformance, select, write_junit
from stepbus_tools.doctor import examine
from stepbus_tools.selftest import SelfTest, Verdict, selftest

_STYLES = {"pass": "green", "fail": "bold red", "skipped": "yellow"}


@command(group="test", is_run=True)
def conformance_command(
    program: Annotated[Sequence[str], {"metavar": "-- PROGRAM"}] = (),
    *,
    bridge: BridgeFormat | None = None,
    scenario: Annotated[str, {"complete": "scenario"}] = "two_link",
    participant: Annotated[str, {"metavar": "NAME"}] = "controller",
    set: Set = (),
    only: Annotated[Sequence[str], {"metavar": "NAME"}] = (),
    list: bool = False,
    logs: Annotated[Path | None, {"metavar": "FOLDER"}] = None,
    junit: Annotated[Path | None, {"metavar": "FILE"}] = None,
    json: Json = False,
) -> Answer:
    """Check a program against the protocol.

    Simulates the orchestrator and all peers of one participant, on the real bus, and checks the
    participant's behaviour: 65 checks, each of one clause of docs/protocol.md. Restarts the program
    for each check. Exit code 0: no check failed, 11: at least one failed.

    program: command line of the program, started in the current folder (default: the one in the
    scenario). bridge: start it through `stepbus bridge`. scenario: scenario that defines the ports.
    participant: participant that the program implements. set: override one value of the scenario,
    e.g. controller.step_timeout=10s. only: run this check; may be repeated. list: list the checks
    and start nothing. logs: keep the program's logs. junit: write JUnit XML.

    $ stepbus conformance -- ./my_controller
    $ stepbus conformance --bridge json -- node controller.mjs
    $ stepbus conformance --only windows --only determinism -- ./my_controller
    $ stepbus conformance --scenario my/scenario.yaml --participant plant
    $ stepbus conformance --list
    """
    if list:
        rows = [{"name": c.name, "clause": c.clause, "summary": c.summary} for c in select(only)]
        row = "{name:20} {clause:6} {summary}"
        return Answer(value=rows, lines=[row.format(**r).replace("`", "") for r in rows])
    loaded, checks = load(scenario, set), select(only)
    with interruptible() as interrupt:
        report = conformance(
            loaded,
            participant,
            program,
            bridge=bridge,
            checks=checks,
            logs=logs,
            on_result=(lambda _result: None) if json else _show,
            interrupt=interrupt,
        )
    if junit is not None:
        write_junit(report, junit)
    return Answer(
        value={"conforms": report.conforms, "report": report},
        lines=[_verdict(report)],
        code=ExitCode.FINISHED if report.conforms else ExitCode.NONCONFORMING,
    )


def _show(result: CheckResult) -> None:
    """Show a result as it comes: a row of a table in a terminal, else a plain line."""
    if not has_screen(sys.stdout):
        say(f"{result.outcome:8} {result.name} ({result.clause}): {result.observed}")
        return
    row = Table.grid(padding=(0, 1), expand=True)
    for width in (7, 19, 6):
        row.add_column(width=width, no_wrap=True)
    row.add_column(ratio=1)
    outcome = f"[{_STYLES[result.outcome]}]{result.outcome}[/]"
    row.add_row(outcome, result.name, result.clause, escape(visible(result.observed)))
    Console().print(row)


def _verdict(report: Report) -> str:
    return (
        f"{report.participant} {'conforms' if report.conforms else 'does not conform'} to protocol "
        f"{PROTOCOL_VERSION}: {report.count('pass')} passed, {report.count('fail')} failed, "
        f"{report.count('skipped')} skipped of {len(report.checks)} checks in {report.wall_s:.0f} s"
    )


@command(group="test")
def doctor_command() -> Answer:
    """Check this machine: versions, bus, disk, extras.

    Checks versions, native libraries, the bus (with a message), disk space and missing
    extras. Exit code 1: something is broken.

    $ stepbus doctor
    """
    findings = examine()
    is_broken = any(finding.verdict == "fail" for finding in findings)
    return Answer(
        value=findings,
        lines=[f"{finding.verdict:4}  {finding.what:18} {finding.text}" for finding in findings],
        code=ExitCode.INTERNAL if is_broken else ExitCode.FINISHED,
    )


@command(group="test", is_run=True)
def selftest_command(
    scenario: ScenarioName,
    *,
    set: Set = (),
    angle: Annotated[float, {"metavar": "DEGREES"}] = 90,
    json: Json = False,
) -> Answer:
    """Move every joint to a known angle and read it back.

    Runs the plant of a scenario without its controller and mission. Moves one joint at a time to
    90° and to -90°, or as far as its limits allow, and checks that this joint moves, in the
    commanded direction, by the commanded angle, within its limits, and that no other joint moves. A
    joint passes if it reaches one side: on the other side the robot may collide with itself. Joints
    in torque mode are pushed forward and back, then set to the angle. Exit code 0: every joint
    passes, 11: at least one fails; otherwise those of `stepbus run`.

    angle: target angle, limited by the range of each joint.

    $ stepbus selftest two_link
    $ stepbus selftest baxter --angle 30
    $ stepbus selftest two_link --json
    """
    loaded = load(scenario, set)
    title = f"{loaded.name} selftest"
    with displayed(title, quiet=json) as display, interruptible() as interrupt:
        result = selftest(loaded, math.radians(angle), display, interrupt)
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
