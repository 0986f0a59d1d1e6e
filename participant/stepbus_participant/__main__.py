"""The process of a participant that is a class: `python -P -m stepbus_participant my.py:Class`.

With `--check`, it reads `[{"participant": …, "params": …}, …]` from standard input and writes for
each a list of problems, `[keys, message]`: a user's code is not imported by the orchestrator.

With `--rehearse my.py:Class`, it reads a `Welcome` from standard input, imports the class, makes an
instance of one of ours, and writes `{"problems": [[keys, message], …], "inputs": …, "outputs": …,
"types": …}`. A class of the user's is only imported: it may open a device.
"""

import contextlib
import gc
import json
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from stepbus_schemas import SHIPPED, Decoder, Types, Welcome, WiringError, error_text

from .config import Config
from .parameters.problems import Keys, Problem, SettingsError
from .parameters.read import find_problems
from .participant import Participant
from .process import main
from .session.admission import Ports, declared_ports
from .user_classes import declared_parameters, import_participant, is_installed, is_ours
from .warm import WARM, become_participants


def _take_part(name: str, folder: Path) -> int:
    source = name.rpartition(":")[0]
    if source.endswith(".py") or not is_installed(source):
        # Only from here on: `python -P` has loaded what is installed, not what the folder has.
        sys.path.insert(0, str(folder))
    # What is imported stays: to look for garbage in it takes a twentieth of a start.
    collects = gc.get_threshold()
    gc.set_threshold(0)
    try:
        factory = import_participant(name, folder)
    except WiringError as exc:
        sys.stderr.write(f"{exc}\n")
        return 1
    gc.freeze()
    if gc.get_threshold()[0] == 0:
        gc.set_threshold(*collects)
    return main(factory)


def _answer(make: Callable[[], Any]) -> int:
    """Write what a call returns as JSON; what the user's code prints goes to standard error."""
    answer = os.dup(1)
    os.dup2(2, 1)
    with contextlib.redirect_stdout(sys.stderr):
        content = make()
    with os.fdopen(answer, "w", encoding="utf-8") as file:
        json.dump(content, file)
    return 0


def _check(folder: Path) -> list[list[tuple[Keys, str]]]:
    requests = json.load(sys.stdin)
    sys.path.insert(0, str(folder))
    return [_problems(row["participant"], row["params"], folder) for row in requests]


def _problems(name: str, params: dict[str, Any], folder: Path) -> list[tuple[Keys, str]]:
    try:
        import_participant(name, folder)
        declared = declared_parameters(name.rpartition(":")[0], folder)
    except WiringError as exc:
        return [(("participant",), str(exc))]
    except SystemExit:
        text = "exits on import; move `raise SystemExit(…)` below `if __name__ == …`"
        return [(("participant",), f"{name.rpartition(':')[0]} {text}")]
    except Exception as exc:  # noqa: BLE001  code of the user's
        source = name.rpartition(":")[0]
        return [(("participant",), f"cannot import {source}: {error_text(exc)}")]
    problems = [] if declared is None else find_problems(declared, params, folder)
    return [(("params", *keys), message) for keys, message in problems]


def _rehearse(name: str, folder: Path) -> dict[str, Any]:
    welcome = Decoder(Welcome)(sys.stdin.buffer.read())
    source = name.rpartition(":")[0]
    if not is_installed(source):
        sys.path.insert(0, str(folder))
    ports = Ports(None, None, SHIPPED)
    problems = _problems(name, welcome.params, folder)
    if not problems:
        cls = import_participant(name, folder)
        ports = declared_ports(cls)
        problems = _problems_of(cls, welcome) if is_ours(source) else []
    said = {"problems": problems, "inputs": ports.inputs, "outputs": ports.outputs}
    return {**said, "types": ports.types.declarations}


def _problems_of(cls: type[Participant], welcome: Welcome) -> list[tuple[Keys, str]]:
    """Return what is wrong with a participant that is made and closed at once."""
    try:
        cls(Config.from_welcome(welcome, Types(welcome.types))).close()
    except SettingsError as exc:
        return [_at_its_key(problem, welcome.params) for problem in exc.problems]
    except Exception as exc:  # noqa: BLE001  what it is told of may be code of the user's
        text = str(exc) if isinstance(exc, WiringError) else error_text(exc)
        return [((), line) for line in text.splitlines()]
    return []


def _at_its_key(problem: Problem, params: Mapping[str, Any]) -> tuple[Keys, str]:
    """Return a problem by its key in the scenario: that of the world, of what has a file."""
    if problem.place.file:
        return ("params", *(["world"] if "world" in params else [])), str(problem)
    return problem.keys[2:], problem.message


if __name__ == "__main__":
    if sys.argv[1:2] == ["--rehearse"]:
        sys.exit(_answer(lambda: _rehearse(sys.argv[2], Path.cwd())))
    if sys.argv[1:] == ["--check"]:
        sys.exit(_answer(lambda: _check(Path.cwd())))
    if sys.argv[1:] and sys.argv[1].rstrip() == WARM:
        sys.argv[1:] = [become_participants(sys.argv[2:])]
    if len(sys.argv) != 2:
        sys.exit("usage: python -P -m stepbus_participant my_file.py:Class")
    sys.exit(_take_part(sys.argv[1], Path.cwd()))
