"""`stepbus conformance`: check a program against the protocol."""

import argparse
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from stepbus_orchestrator.cli import Command, add_overrides, interruptible, say, say_json, visible
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.scenario import load
from stepbus_schemas import BRIDGE_FORMATS, PROTOCOL_VERSION
from stepbus_tools.conformance import (
    CHECKS,
    CheckResult,
    Report,
    conformance,
    select,
)
from stepbus_tools.conformance.outcome import write_junit

_STYLES = {"pass": "green", "fail": "bold red", "skipped": "yellow"}


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "program",
        nargs="*",
        metavar="-- PROGRAM",
        help="command line of the program, started in the current folder (default: that of the "
        "scenario)",
    )
    parser.add_argument(
        "--bridge", choices=BRIDGE_FORMATS, help="start it through `stepbus bridge`"
    )
    parser.add_argument(
        "--scenario", default="two_link", help="scenario whose ports are played (default: two_link)"
    )
    parser.add_argument(
        "--participant",
        default="controller",
        metavar="NAME",
        help="participant that the program plays (default: controller)",
    )
    add_overrides(parser, "override one value of the scenario, e.g. controller.step_timeout=10s")
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="NAME",
        help="run this check; may be repeated",
    )
    parser.add_argument("--list", action="store_true", help="list the checks and start nothing")
    parser.add_argument("--logs", type=Path, metavar="FOLDER", help="keep the program's logs")
    parser.add_argument("--junit", type=Path, metavar="FILE", help="write JUnit XML")
    parser.add_argument("--json", action="store_true", help="print the result as JSON only")


def _execute(args: argparse.Namespace) -> int:
    if args.list:
        return _list(args)
    scenario = load(args.scenario, args.set)
    checks = select(args.only)
    with interruptible() as interrupt:
        report = conformance(
            scenario,
            args.participant,
            args.program,
            bridge=args.bridge,
            checks=checks,
            logs=args.logs,
            on_result=(lambda _result: None) if args.json else _show,
            interrupt=interrupt,
        )
    if args.junit is not None:
        write_junit(report, args.junit)
    if args.json:
        say_json({"conforms": report.conforms, "report": report})
    else:
        _conclude(report)
    return ExitCode.FINISHED if report.conforms else ExitCode.NONCONFORMING


def _list(args: argparse.Namespace) -> int:
    checks = select(args.only)
    if args.json:
        say_json([{"name": c.name, "clause": c.clause, "summary": c.summary} for c in checks])
        return ExitCode.FINISHED
    for check in checks:
        summary = check.summary.replace("`", "")
        say(f"{check.name:20} {check.clause:6} {summary}")
    return ExitCode.FINISHED


def _show(result: CheckResult) -> None:
    """Show a result as it comes: a row of a table in a terminal, else a plain line."""
    console = Console()
    if console.is_terminal:
        console.print(_row(result))
    else:
        say(f"{result.outcome:8} {result.name} ({result.clause}): {result.observed}")


def _row(result: CheckResult) -> Table:
    row = Table.grid(padding=(0, 1), expand=True)
    for width in (7, 19, 6):
        row.add_column(width=width, no_wrap=True)
    row.add_column(ratio=1)
    style = _STYLES[result.outcome]
    row.add_row(
        f"[{style}]{result.outcome}[/]",
        result.name,
        result.clause,
        escape(visible(result.observed)),
    )
    return row


def _conclude(report: Report) -> None:
    counts = [f"{report.count('pass')} passed", f"{report.count('fail')} failed"]
    counts.append(f"{report.count('skipped')} skipped")
    verdict = "conforms" if report.conforms else "does not conform"
    say(
        f"{report.participant} {verdict} to protocol {PROTOCOL_VERSION}: {', '.join(counts)} of "
        f"{len(report.checks)} checks in {report.wall_s:.0f} s"
    )


COMMAND = Command(
    name="conformance",
    summary="check a program against the protocol",
    description="Plays the orchestrator and all peers of one participant, over the real bus, and "
    f"checks its behaviour: {len(CHECKS)} checks, each of one clause of docs/protocol.md. Starts "
    "the program again for each check. Exit code 0: no check failed, 11: one did.",
    examples=(
        "stepbus conformance -- ./my_controller",
        "stepbus conformance --bridge json -- node controller.mjs",
        "stepbus conformance --only windows --only determinism -- ./my_controller",
        "stepbus conformance --scenario my/scenario.yaml --participant plant",
        "stepbus conformance --list",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
    is_run=True,
)
