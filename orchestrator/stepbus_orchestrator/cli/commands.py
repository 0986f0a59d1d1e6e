"""The commands of the command line."""

import argparse
import textwrap
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version

from stepbus_orchestrator.errors import ExitCode, RunFailure
from stepbus_schemas import StepbusError

from .command import Command
from .participants import bridge as bridge_command
from .participants import conformance as conformance_command
from .participants import selftest as selftest_command
from .recordings import branch as branch_command
from .recordings import diff as diff_command
from .recordings import plot as plot_command
from .recordings import recover as recover_command
from .recordings import replay as replay_command
from .recordings import rerun as rerun_command
from .scenarios import call as call_command
from .scenarios import describe as describe_command
from .scenarios import run as run_command
from .scenarios import types as types_command
from .scenarios import validate as validate_command
from .scenarios import verify as verify_command
from .setup import doctor as doctor_command
from .setup import new as new_command
from .terminal.outlet import hurry
from .terminal.output import print_error

_COLUMNS = 79

COMMANDS: tuple[Command, ...] = (
    run_command.COMMAND,
    validate_command.COMMAND,
    describe_command.COMMAND,
    types_command.COMMAND,
    selftest_command.COMMAND,
    call_command.COMMAND,
    new_command.COMMAND,
    doctor_command.COMMAND,
    replay_command.COMMAND,
    diff_command.COMMAND,
    plot_command.COMMAND,
    verify_command.COMMAND,
    rerun_command.COMMAND,
    branch_command.COMMAND,
    recover_command.COMMAND,
    conformance_command.COMMAND,
    bridge_command.COMMAND,
)


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = argparse.ArgumentParser(
        prog="stepbus",
        description="Co-simulation for robotics: plant, controller and mission as separate "
        "processes in lockstep over Zenoh, recorded to MCAP.",
        epilog="example: stepbus run two_link",
    )
    parser.add_argument("--version", action="version", version=f"stepbus {_version()}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for command in COMMANDS:
        sub = commands.add_parser(
            command.name,
            help=command.summary,
            description=textwrap.fill(command.description, _COLUMNS),
            epilog="examples:\n" + "\n".join(f"  {line}" for line in command.examples),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.add_arguments(sub)
        sub.set_defaults(command=command)
    return parser


def _version() -> str:
    try:
        return version("stepbus")
    except PackageNotFoundError:
        return "(not installed, only found)"


def execute(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code."""
    args = make_parser().parse_args(arguments)
    if args.command.is_run:
        hurry()
    try:
        code: int = args.command.execute(args)
    except RunFailure as exc:
        print_error(str(exc))
        return exc.code
    except StepbusError as exc:
        print_error(str(exc))
        return ExitCode.SCENARIO
    except OSError as exc:
        # What no command expects of a file or folder, e.g. that the current one is gone.
        print_error(f"{exc.filename or 'the current folder'}: {exc.strerror or exc}")
        return ExitCode.INTERNAL
    return code
