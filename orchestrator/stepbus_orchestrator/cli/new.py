"""`stepbus new`: a scenario with a controller to start from."""

import argparse
import shlex
from pathlib import Path

from stepbus_orchestrator.cli.command import Command
from stepbus_orchestrator.cli.output import say
from stepbus_orchestrator.cli.starter import STARTERS, write_starter


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, help="folder to create; may exist if it is empty")
    parser.add_argument(
        "--language",
        default="python",
        metavar="LANGUAGE",
        help=f"language of the controller: {', '.join(STARTERS)} (default: python)",
    )


def _execute(args: argparse.Namespace) -> int:
    files = write_starter(args.folder, args.language)
    say(f"{args.folder}: {', '.join(map(str, files))}")
    folder = shlex.quote(str(args.folder))
    build = STARTERS[args.language].build.format(folder=folder)
    say(f"next: {build} && stepbus run {folder}" if build else f"next: stepbus run {folder}")
    return 0


COMMAND = Command(
    name="new",
    summary="create a scenario with a controller of your own",
    description="Creates a folder with a scenario of the built-in plant and mission, its model, "
    "and a small PD controller to change, in a language of your choice. It runs as it is once you "
    "have installed what its README names.",
    examples=("stepbus new my_scenario", "stepbus new --language octave my_scenario"),
    add_arguments=_add_arguments,
    execute=_execute,
)
