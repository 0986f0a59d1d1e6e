"""`stepbus selftest`: move every joint to a known angle in turn and read it back."""

import argparse
import math
import sys

from rich.console import Console
from rich.table import Table

from stepbus_orchestrator.cli import (
    Command,
    add_scenario_arguments,
    displayed,
    interruptible,
    say,
    say_json,
)
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.scenario import load
from stepbus_tools.selftest import SelfTest, Verdict, selftest

_COLUMNS = ("joint", "mode", "commanded", "measured", "rad or m", "others", "verdict")
_PLAIN_COLUMNS = 160


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scenario_arguments(parser)
    parser.add_argument(
        "--angle",
        type=float,
        default=90.0,
        metavar="DEGREES",
        help="target angle, as far as the stops of a joint allow (default: 90)",
    )
    parser.add_argument("--json", action="store_true", help="print JSON for programs")


def _execute(args: argparse.Namespace) -> int:
    scenario = load(args.scenario, args.set)
    title = f"{scenario.name} selftest"
    with displayed(title, quiet=args.json) as display, interruptible() as interrupt:
        result = selftest(scenario, math.radians(args.angle), display, interrupt)
    if args.json:
        say_json(result)
    else:
        _show(result)
    return ExitCode.FINISHED if result.ok else ExitCode.NONCONFORMING


def _show(result: SelfTest) -> None:
    console = Console(width=None if sys.stdout.isatty() else _PLAIN_COLUMNS)
    table = Table(*_COLUMNS)
    for verdict in result.joints:
        table.add_row(*_row(verdict))
    console.print(table)
    wrong = [verdict.joint for verdict in result.joints if not verdict.ok]
    idle = [verdict.joint for verdict in result.joints if verdict.commanded is None]
    tested = len(result.joints) - len(idle)
    say(
        f"{result.plant}: {tested - len(wrong)} of {tested} joints pass "
        f"({result.simulated_s:.1f} s simulated)"
        + (f"; without a motor: {', '.join(idle)}" if idle else "")
    )


def _row(verdict: Verdict) -> list[str]:
    if verdict.commanded is None or verdict.measured is None:
        return [verdict.joint, verdict.mode, "", "", "", "", "no motor"]
    others = "" if verdict.others is None else _people(verdict, verdict.others[1])
    return [
        verdict.joint,
        verdict.mode,
        _people(verdict, verdict.commanded),
        _people(verdict, verdict.measured),
        f"{verdict.measured:.4f}",
        others,
        "; ".join(
            filter(None, ("ok" if verdict.ok else "", *verdict.findings, verdict.other_side))
        ),
    ]


def _people(verdict: Verdict, value: float) -> str:
    if verdict.type == "prismatic":
        return f"{1e3 * value:.2f} mm"
    return f"{math.degrees(value):.2f}°"


COMMAND = Command(
    name="selftest",
    summary="move every joint to a known angle and read it back",
    description="Runs the plant of a scenario without its controller and mission, moves one joint "
    "after the other to 90° and to -90°, or as far as its stops allow, and checks that this joint "
    "moves, in this direction, by this much, within its limits, and that no other does. One side "
    "is enough: on the other the robot may be in its own path. Joints of mode torque are pushed "
    "forward and back and put at the angle. Exit code 0: every joint passes, 11: one fails; "
    "otherwise those of run.",
    examples=(
        "stepbus selftest two_link",
        "stepbus selftest baxter --angle 30",
        "stepbus selftest two_link --json",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
    is_run=True,
)
