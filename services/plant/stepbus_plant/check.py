"""What only loading a world shows to be wrong with it: `python -m stepbus_plant.check`.

It reads a `Welcome` from standard input, makes the plant that this asks for, and writes what is
wrong as JSON, `[[keys, message], …]`. A process of its own: PyBullet prints what it likes, and may
crash.
"""

import json
import os
import re
import sys
from collections.abc import Iterator

from stepbus_participant import Config
from stepbus_participant.parameters import Keys
from stepbus_schemas import Decoder, Description, Types, Welcome, WiringError

from .participant import Plant

_PARAMETER = re.compile(r"params\.([\w.\[\]]+): (.*)")
_PORT = re.compile(r"(?:input )?'?([\w-]+)'?: (.*)")


def problems(config: Config) -> list[tuple[Keys, str]]:
    """Return what is wrong with a plant: keys of the participant and a sentence each."""
    try:
        plant = Plant(config)
    except WiringError as exc:
        return list(_located(str(exc), config))
    try:
        plant.start(dict.fromkeys(config.inputs, Description()))
    except WiringError as exc:
        return list(_located(str(exc), config))
    finally:
        plant.close()
    return []


def _located(text: str, config: Config) -> Iterator[tuple[Keys, str]]:
    """Yield each line of an error at what it is about: a parameter, a port, or else the world."""
    for line in text.removeprefix(f"{config.name}: ").splitlines():
        parameter, port = _PARAMETER.fullmatch(line), _PORT.fullmatch(line)
        if parameter:
            keys = re.findall(r"\w+", parameter[1])
            path = tuple(int(key) if key.isdigit() else key for key in keys)
            yield ("params", *path), parameter[2]
        elif port and port[1] in config.inputs:
            yield ("inputs", port[1]), port[2]
        elif port and port[1] in config.outputs:
            yield ("outputs", port[1]), port[2]
        else:
            yield ("params", "world"), line


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
