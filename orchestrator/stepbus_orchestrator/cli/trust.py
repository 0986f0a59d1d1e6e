"""Asks before the programs of a recording that was made elsewhere are started."""

import sys
from pathlib import Path

from stepbus_orchestrator.cli.terminal.output import print_error, write
from stepbus_orchestrator.errors import Untrusted, indented
from stepbus_orchestrator.replay.sources import Recorded
from stepbus_orchestrator.replay.trust import Programs, programs_of
from stepbus_orchestrator.replay.work_tree import WorkTree


def trusted_programs(
    opened: Recorded,
    participant: str | None = None,
    *,
    trust: bool,
    own_program: bool = False,
    tree: WorkTree | None = None,
) -> str:
    """Return the fingerprint of the programs that may be started.

    Those that are not in a work tree of this user's are shown, and need `trust` or a yes. Raises
    Untrusted without one.
    """
    programs = programs_of(opened, participant, own_program=own_program, tree=tree)
    if not (programs.is_yours or trust):
        _ask(opened.path, programs, tree)
    for note in programs.notes():
        print_error(note)
    return programs.fingerprint


def _ask(recording: Path, programs: Programs, tree: WorkTree | None) -> None:
    has_terminal = sys.stdin.isatty() and sys.stderr.isatty()
    rows = "\n".join(f"  {indented(line)}" for line in programs.lines())
    shown = (
        f"{recording} contains programs that are not in your work tree. They would run with "
        "your permissions:"
    )
    if tree is not None and not tree.is_yours:
        shown = (
            f"{tree.shown()} can be written by other users. Its programs would run with your "
            "permissions:"
        )
    if has_terminal:
        write(sys.stderr, f"{shown}\n{rows}\nStart them? [y/N] ")
        if sys.stdin.readline().strip().lower() in {"y", "yes"}:
            return
        raise Untrusted("cancelled: no program was started")
    raise Untrusted(
        f"{shown}\n{rows}\nnothing was started; if you trust these programs, use --trust"
    )
