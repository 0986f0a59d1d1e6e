"""Reads the command that is typed, executes it, and says why it cannot be."""

import difflib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from cyclopts import CycloptsError, MissingArgumentError, UnknownOptionError, UnusedCliTokensError

from stepbus_orchestrator.errors import ExitCode, RunFailure
from stepbus_orchestrator.plugins import CommandBroken
from stepbus_orchestrator.recording.source import watchers
from stepbus_orchestrator.scenario.model import ScenarioFile
from stepbus_participant import extra_hint
from stepbus_schemas import StepbusError

from .app import app_of, label, load_command, refuse
from .options import Command
from .terminal.output import Answer, ReadingLine, has_screen, print_error
from .terminal.stdout_buffer import hurry


def execute(arguments: Sequence[str], loaded: Callable[[], None] = lambda: None) -> int:
    """Run one command and return its exit code. loaded: is called when it is loaded."""
    try:
        " ".join((*arguments, str(Path.cwd()))).encode()
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
    if has_screen(sys.stderr):
        watchers.append(ReadingLine())
    answer = work(command)
    is_json: bool = getattr(command, "json", False)
    return answer.show(as_json=is_json) if isinstance(answer, Answer) else int(answer)


def parsed(name: str, *words: str) -> Command:
    """Return the command that is typed, with its options; say what is wrong with them, and exit."""
    app = app_of(load_command(name))
    try:
        make, given, _ = app.parse_args([name, *words], print_error=False, exit_on_error=False)
    except CycloptsError as exc:
        refuse(_sentence(exc), f"stepbus {name}")
    command: Command = make(*given.args, **given.kwargs)
    return command


def _sentence(error: CycloptsError) -> str:
    error.verbose = False
    if isinstance(error, MissingArgumentError) and error.argument and not error.keyword:
        return f"{label(error.argument)} is missing"
    if isinstance(error, UnusedCliTokensError):
        return f"too many arguments: {' '.join(error.unused_tokens or ())}"
    text = str(error)
    if isinstance(error, UnknownOptionError):
        # Many look for an option where the scenario has a value.
        word = error.token.keyword or ""
        near = difflib.get_close_matches(word[2:], ScenarioFile.__struct_encode_fields__, 1)
        if near and "Did you mean" not in text:
            return f"{text} Did you mean '--set {near[0]}=VALUE'?"
    return text
