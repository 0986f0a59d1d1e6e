"""Asks before the programs of a recording that was made elsewhere are started."""

import argparse
import sys

from stepbus_orchestrator.cli.terminal.output import visible
from stepbus_orchestrator.errors import Untrusted, indented
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.recording.known_programs import folder_mark, remember
from stepbus_orchestrator.replay.programs.trust import Programs, programs_of
from stepbus_orchestrator.replay.programs.work_tree import WorkTree


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Declare `--trust`."""
    parser.add_argument(
        "--trust",
        action="store_true",
        help="start the programs of a recording that was made elsewhere, without asking",
    )


def trusted_programs(
    args: argparse.Namespace,
    participant: str | None = None,
    *,
    own_program: bool = False,
    tree: WorkTree | None = None,
) -> str:
    """Return the fingerprint of the programs that may be started.

    Those that this user has not run on this machine are shown, and need `--trust` or a yes; they
    are remembered then. Raises Untrusted without one.
    """
    recording = Recording(args.recording)
    programs = programs_of(recording, participant, own_program=own_program, tree=tree)
    if not programs.is_harmless:
        if not args.trust:
            _ask(args, programs, tree)
        remember(programs.fingerprint if tree is None else folder_mark(tree.folder))
    return programs.fingerprint


def _ask(args: argparse.Namespace, programs: Programs, tree: WorkTree | None) -> None:
    has_terminal = sys.stdin.isatty() and sys.stderr.isatty()
    rows = "\n".join(f"  {indented(line)}" for line in programs.lines())
    shown = f"{args.recording} was not made by you on this machine. It starts, with your rights:"
    if tree is not None:
        shown = f"You have not run {tree.shown()} on this machine. It starts, with your rights:"
    if has_terminal:
        sys.stderr.write(visible(f"{shown}\n{rows}\nStart that? [y/N] "))
        sys.stderr.flush()
        if sys.stdin.readline().strip().lower() in {"y", "yes"}:
            return
        raise Untrusted("nothing was started")
    raise Untrusted(f"{shown}\n{rows}\nnothing was started; if you trust that, use --trust")
