"""The cause of a program's end, as its log has it, in the words of its language."""

import re
from collections.abc import Sequence
from pathlib import Path

from .packages import import_error_hint

_TAIL_BYTES = 16_000
_LONGEST = 300
_TRACEBACK = "Traceback (most recent call last):"

_ERROR = re.compile(
    r"error|exception|panic|fatal|fail|cannot|can't|could not|assert|not found|unable"
    # Perl's `die`.
    r"| at \S+ line \d+[.,]"
    # Lua's `error`, by the name of its interpreter.
    r"|^\S*\blua[\d.]*: ",
    re.IGNORECASE,
)
_NOISE = re.compile(
    r"pybullet build time:"  # printed whenever it is loaded
    r"|error: called from|error: ignoring const "  # Octave, behind its error
    r"|BEGIN failed--|Compilation failed in require|Execution of .* aborted due to"  # Perl
    r"|note: |help: |stack backtrace:"  # Rust
    r"|stack traceback:$"  # Lua, behind its error
    r"|Node\.js v\d|exit status \d|goroutine \d|Exception ignored "
    r"|.*\b(0|no) (errors?|failures?|exceptions?)\b",
    re.IGNORECASE,
)
_JOINED = re.compile(
    r"thread '.*' .*panicked at .*:$"  # Rust: the message is in the next line
    r"|terminate called after throwing an instance of "  # C++: likewise, behind `what():`
)


def last_error(log: Path) -> str:
    """Return the cause of the last error in a log, or else its last line; empty where none is.

    It is the line that names the error, not the stack or the hints that languages print behind it.
    """
    try:
        with log.open("rb") as file:
            file.seek(max(0, file.seek(0, 2) - _TAIL_BYTES))
            text = file.read().decode(errors="replace")
    except OSError:
        return ""
    lines = [line.rstrip() for line in text.split("\n")]
    lines = [line for line in lines if line and not _NOISE.match(line.lstrip())]
    cause = _cause(lines)[:_LONGEST]
    return cause + import_error_hint(cause)


def _cause(lines: Sequence[str]) -> str:
    errors = [index for index, line in enumerate(lines) if _ERROR.search(line)]
    # Stacks are indented, and may be of files and functions called `error`.
    at = [index for index in errors if not lines[index][0].isspace()] or errors
    raised = _raised(lines)
    joined = [index for index in at if _JOINED.match(lines[index])]
    if raised is not None and not any(index > raised for index in joined):
        return lines[raised].strip()
    if joined:
        return " ".join(line.strip() for line in lines[joined[-1] : joined[-1] + 2])
    return (lines[at[-1]] if at else lines[-1] if lines else "").strip()


def _raised(lines: Sequence[str]) -> int | None:
    """Return the line of the exception below the last traceback of Python.

    Its message may have further lines, and what is printed at the exit stands behind it.
    """
    starts = [index for index, line in enumerate(lines) if line.startswith(_TRACEBACK)]
    if not starts:
        return None
    below = range(starts[-1] + 1, len(lines))
    return next((index for index in below if not lines[index][0].isspace()), None)
