"""Asks before the programs of a recording that was made elsewhere are started."""

import argparse
import sys

from stepbus_orchestrator.errors import Untrusted
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.recording.known_programs import remember
from stepbus_orchestrator.replay.trust import Programs, programs_of


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Declare `--trust`."""
    parser.add_argument(
        "--trust",
        action="store_true",
        help="start the programs of a recording that was made elsewhere, without asking",
    )


def trusted_programs(
    args: argparse.Namespace, participant: str | None = None, *, own_program: bool = False
) -> str:
    """Return the fingerprint of the programs that may be started.

    Those that this user has not run on this machine are shown, and need `--trust` or a yes; they
    are remembered then. Raises Untrusted without one.
    """
    programs = programs_of(Recording(args.recording), participant, own_program=own_program)
    if not programs.is_harmless:
        if not args.trust:
            _ask(args, programs)
        remember(programs.fingerprint)
    return programs.fingerprint


def _ask(args: argparse.Namespace, programs: Programs) -> None:
    has_terminal = sys.stdin.isatty() and sys.stderr.isatty()
    rows = "\n".join(f"  {line}" for line in programs.lines())
    shown = f"{args.recording} was not made by you on this machine. It starts, with your rights:"
    if has_terminal:
        sys.stderr.write(f"{shown}\n{rows}\nStart that? [y/N] ")
        sys.stderr.flush()
        if sys.stdin.readline().strip().lower() in {"y", "yes"}:
            return
        raise Untrusted("nothing was started")
    raise Untrusted(f"{shown}\n{rows}\nnothing was started; if you trust that, use --trust")
