"""Executes the command that is typed, and says what is wrong."""

import contextlib
import difflib
import re
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import NoReturn

import msgspec

from stepbus_orchestrator.cli.terminal.output import print_error
from stepbus_orchestrator.cli.terminal.stdout_buffer import hurry
from stepbus_orchestrator.errors import ExitCode, RunFailure, command_line
from stepbus_orchestrator.plugins import COMMANDS, named_points
from stepbus_orchestrator.processes.warm import warm_parent
from stepbus_orchestrator.scenario.model import ScenarioFile
from stepbus_participant import extra_hint, suggest
from stepbus_schemas import StepbusError

from .overview import MODULES, CommandBroken, command_names, load_command, not_utf8


def execute(arguments: Sequence[str], loaded: Callable[[], None] = lambda: None) -> int:
    """Run one command and return its exit code. loaded: is called when it is loaded."""
    if odd := not_utf8(arguments):
        print_error(
            f"{odd!a} is not valid UTF-8; if it is valid in your terminal, set LC_ALL=C.UTF-8"
        )
        return ExitCode.SCENARIO
    try:
        # From the start on: it loads on a core of its own what participants need.
        is_forking = arguments[0] == "run" and "--in-process" not in arguments
        with warm_parent() if is_forking else contextlib.nullcontext():
            return _executed(*arguments, loaded=loaded)
    except RunFailure as exc:
        print_error(str(exc))
        return exc.code
    except (StepbusError, CommandBroken) as exc:
        print_error(str(exc))
        return ExitCode.SCENARIO
    except OSError as exc:
        # What no command expects of a file or folder, e.g. that the current one is gone.
        print_error(f"{exc.filename or 'the current folder'}: {exc.strerror or exc}")
        return ExitCode.INTERNAL


def _executed(name: str, *words: str, loaded: Callable[[], None]) -> int:
    if name.startswith("-"):
        refuse(f"{name} is not an option of stepbus; write options after the command")
    # The core's own first: to find the others takes a while.
    if name not in MODULES and name not in named_points(COMMANDS):
        refuse(f"no command {name!r}{_meant(name, command_names())}")
    command = load_command(name)
    # cyclopts takes a while to load, in which the warm parent loads too.
    reading = import_module(f"{__package__}.words")
    try:
        given = reading.read_words(command, words)
    except ValueError as exc:
        refuse(_with_setting(str(exc)), f"stepbus {name}")
    try:
        run = command.load()
    except (ImportError, AttributeError) as exc:
        if extra_hint(getattr(exc, "name", None) or "") or ".so" in str(exc):
            raise
        raise CommandBroken(
            f"the command {name!r} cannot be loaded from {command.execute}: {exc}"
        ) from exc
    loaded()
    if command.is_run:
        hurry()
    with command_line():
        code: int = run(*given.args, **given.kwargs)
    return code


def refuse(message: str, prog: str = "stepbus") -> NoReturn:
    """Print what is wrong with the words that are typed, and exit."""
    end = "" if message.endswith("?") else ";"
    print_error(f"{message}{end} see {prog} --help")
    raise SystemExit(int(ExitCode.SCENARIO))


def _meant(word: str, known: Sequence[str]) -> str:
    near = suggest(word, known)
    return near if "did you mean" in near else ""


def _with_setting(message: str) -> str:
    """Return a message that tells of an unknown option which value of the scenario is meant."""
    option = re.fullmatch("unknown option --([a-z-]+)", message)
    fields = [field.encode_name for field in msgspec.structs.fields(ScenarioFile)]
    near = difflib.get_close_matches(option[1], fields, 1) if option else []
    return f"{message}; did you mean '--set {near[0]}=VALUE'?" if near else message
