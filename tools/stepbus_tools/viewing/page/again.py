"""The commands that run a run again."""

import shlex
from html import escape
from pathlib import Path

from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.scenario.locate import builtin_name

from .content import RunPage


def again(run: RunPage) -> str:
    """Return the commands that run it again, as HTML."""
    rows = [run_again(run), f"stepbus rerun {shlex.quote(short(run.path))}"]
    return "".join(f"<pre>{escape(row)}</pre>" for row in rows if row)


def run_again(run: RunPage) -> str:
    """Return the command that runs its scenario again; empty where no result says how."""
    result = run.result
    if result is None or not result.file:
        return ""
    sets = [f" --set {shlex.quote(text)}" for text in result.overrides]
    faults = [f" --fault {shlex.quote(text)}" for text in result.faults]
    return "".join(["stepbus run ", shlex.quote(_scenario(result)), *sets, *faults])


def short(path: Path) -> str:
    """Return a path as seen from here, or its last two parts: nobody else has these folders."""
    try:
        return str(path.absolute().relative_to(Path.cwd()))
    except (OSError, ValueError):  # this folder is gone, or the path is elsewhere
        return str(Path(*path.parts[-2:]))


def _scenario(result: Result) -> str:
    """Return how to name its scenario: by its name where a package has it, or by its file."""
    path = Path(result.file)
    return builtin_name(path) or (short(path) if path.is_absolute() else result.file)
