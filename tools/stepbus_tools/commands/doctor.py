"""`stepbus doctor`: check whether this machine has what stepbus needs."""

import argparse

from stepbus_orchestrator.cli import Command, say, say_json
from stepbus_orchestrator.errors import ExitCode
from stepbus_tools.doctor import examine


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print JSON for programs")


def _execute(args: argparse.Namespace) -> int:
    findings = examine()
    if args.json:
        say_json(findings)
    else:
        for finding in findings:
            say(f"{finding.verdict:4}  {finding.what:18} {finding.text}")
    failed = any(finding.verdict == "fail" for finding in findings)
    return ExitCode.INTERNAL if failed else ExitCode.FINISHED


COMMAND = Command(
    name="doctor",
    summary="check this machine: versions, bus, ports, disk, extras",
    description="Checks versions, native libraries, the bus (with a message), free ports, disk "
    "space and missing extras. Exit code 1: something is broken.",
    examples=("stepbus doctor",),
    add_arguments=_add_arguments,
    execute=_execute,
)
