"""What only loading a world shows to be wrong with it: `python -m stepbus_plant.check`.

It reads a `Welcome` from standard input, makes the plant that this asks for, and writes what is
wrong as JSON, `[[keys, message], …]`. A process of its own: PyBullet prints what it likes, and may
crash.
"""

import json
import os
import sys
from contextlib import closing

from stepbus_participant import Config, SettingsError
from stepbus_participant.parameters import Keys, Problem
from stepbus_schemas import Decoder, Description, Types, Welcome

from .participant import Plant


def problems(config: Config) -> list[tuple[Keys, str]]:
    """Return what is wrong with a plant: keys of the participant and a sentence each."""
    try:
        with closing(Plant(config)) as plant:
            plant.start(dict.fromkeys(config.inputs, Description()))
    except SettingsError as exc:
        return list(map(_answer, exc.problems))
    return []


def _answer(problem: Problem) -> tuple[Keys, str]:
    """Return a problem by its key in the scenario: that of the world, of what has a file."""
    if problem.file:
        return ("params", "world"), str(problem)
    return problem.keys[2:], problem.message


def main() -> int:
    """Answer the `Welcome` on standard input; what the engine prints goes to stderr."""
    welcome = Decoder(Welcome)(sys.stdin.buffer.read())
    answer = os.dup(1)
    os.dup2(2, 1)
    wrong = problems(Config.from_welcome(welcome, Types(welcome.types)))
    with os.fdopen(answer, "w", encoding="utf-8") as file:
        json.dump(wrong, file)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
