"""Refuses to start the programs of a recording that are not the user's, without `--trust`."""

from stepbus_orchestrator.cli.terminal.output import print_error
from stepbus_orchestrator.errors import Untrusted, indented
from stepbus_orchestrator.replay.sources import Recorded
from stepbus_orchestrator.replay.trust import programs_of


def check_trust(
    opened: Recorded, participant: str | None = None, *, trust: bool, own_program: bool = False
) -> None:
    """Raise Untrusted for programs that are not the user's, unless `trust`; name edited files."""
    programs = programs_of(opened, participant, own_program=own_program)
    if not (programs.is_yours or trust):
        rows = "\n".join(f"  {indented(line)}" for line in programs.lines())
        raise Untrusted(
            f"{opened.path} contains programs that are not those of your scenario. They would run "
            f"with your permissions:\n{rows}\nnothing was started; if you trust these programs, "
            "use --trust"
        )
    for note in programs.notes():
        print_error(note)
