"""The process of a participant that is a class: `python -P -m stepbus_participant my.py:Class`.

With `--check`, it reads `[{"participant": …, "params": …}, …]` from standard input and writes for
each a list of problems, `[keys, message]`: a user's code is not imported by the orchestrator.
"""

import contextlib
import gc
import json
import os
import sys
from pathlib import Path
from typing import Any

from stepbus_schemas import WiringError, error_text

from .parameters.problems import Keys
from .parameters.read import find_problems
from .process import main
from .user_classes import declared_parameters, import_participant, is_installed
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


def _check(requests: list[dict[str, Any]], folder: Path) -> int:
    sys.path.insert(0, str(folder))
    answer = os.dup(1)
    os.dup2(2, 1)
    with contextlib.redirect_stdout(sys.stderr):
        answers = [_problems(row["participant"], row["params"], folder) for row in requests]
    with os.fdopen(answer, "w", encoding="utf-8") as file:
        json.dump(answers, file)
    return 0


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


if __name__ == "__main__":
    if sys.argv[1:] == ["--check"]:
        sys.exit(_check(json.load(sys.stdin), Path.cwd()))
    if sys.argv[1:] and sys.argv[1].rstrip() == WARM:
        sys.argv[1:] = [become_participants(sys.argv[2:])]
    if len(sys.argv) != 2:
        sys.exit("usage: python -P -m stepbus_participant my_file.py:Class")
    sys.exit(_take_part(sys.argv[1], Path.cwd()))
