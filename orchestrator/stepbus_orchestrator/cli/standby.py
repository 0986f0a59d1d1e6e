"""The process of one run of `stepbus run --watch`: it has loaded everything before the run is due.

It is a process of its own, so that no run sees a module of the one before.
"""

import os
from collections.abc import Sequence
from pathlib import Path

_VARIABLE = "STEPBUS_WATCH"
"""Set by the watch for this process alone: the descriptor that the folder of its run comes from."""
_pipe: list[int] = []


def watches(words: Sequence[str]) -> bool:
    """Return whether this process is to watch, not to run."""
    return "--watch" in words and _VARIABLE not in os.environ and not _pipe


def environment(pipe: int) -> dict[str, str]:
    """Return the environment of such a process."""
    return {**os.environ, _VARIABLE: str(pipe)}


def take() -> None:
    """Take the descriptor, of which no participant is to know."""
    if text := os.environ.pop(_VARIABLE, ""):
        _pipe.append(int(text))
        os.set_inheritable(int(text), False)


def await_folder() -> Path:
    """Return the folder of the run once it is due; end where it never will be."""
    try:
        with os.fdopen(_pipe[0], "rb") as file:
            folder = os.fsdecode(file.read())
    except KeyboardInterrupt:
        folder = ""
    if not folder:
        raise SystemExit(0)
    return Path(folder)
