"""Executes the command that is typed, and says why it cannot be."""

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path

from stepbus_orchestrator.errors import ExitCode, RunFailure
from stepbus_orchestrator.plugins import CommandBroken
from stepbus_orchestrator.processes.warm import warm_parent
from stepbus_participant import extra_hint
from stepbus_schemas import StepbusError

from .terminal.output import Answer, print_error
from .terminal.stdout_buffer import hurry


def execute(arguments: Sequence[str], loaded: Callable[[], None] = lambda: None) -> int:
    """Run one command and return its exit code. loaded: is called when it is loaded."""
    try:
        " ".join((*arguments, str(Path.cwd()))).encode()
        # From the start on: it loads on a core of its own what participants need.
        is_forking = arguments[0] == "run" and "--in-process" not in arguments
        with warm_parent() if is_forking else contextlib.nullcontext():
            return _executed(arguments, loaded)
    except RunFailure as exc:
        print_error(str(exc))
        return exc.code
    except (StepbusError, CommandBroken) as exc:
        print_error(str(exc))
        return ExitCode.SCENARIO
    except UnicodeEncodeError as exc:
        hint = "if it is valid in your terminal, set LC_ALL=C.UTF-8"
        print_error(f"{exc.object!a} is not valid UTF-8; {hint}")
        return ExitCode.SCENARIO
    except OSError as exc:
        # What no command expects of a file or folder, e.g. that the current one is gone.
        print_error(f"{exc.filename or 'the current folder'}: {exc.strerror or exc}")
        return ExitCode.INTERNAL


def _executed(arguments: Sequence[str], loaded: Callable[[], None]) -> int:
    # cyclopts takes a while to load, in which the warm parent loads too.
    from .app import parsed  # noqa: PLC0415

    command = parsed(*arguments)
    try:
        work = command.load()
    except (ImportError, AttributeError) as exc:
        if extra_hint(getattr(exc, "name", None) or "") or ".so" in str(exc):
            raise
        raise CommandBroken(f"the command {arguments[0]!r} cannot be loaded: {exc}") from exc
    loaded()
    if command.is_run:
        hurry()
    answer = work(command)
    is_json: bool = getattr(command, "json", False)
    return answer.show(as_json=is_json) if isinstance(answer, Answer) else int(answer)
