"""Where the command line prints, and what a command has come to."""

import os
import sys
from collections.abc import Iterable
from dataclasses import dataclass

import msgspec

_PLAIN_COLUMNS = 200
_CONTROLS = (*range(9), *range(11, 32), *range(0x7F, 0xA0), 0x2028, 0x2029)
_DIRECTIONS = (0x061C, 0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A))
_ESCAPES = {
    code: f"\\x{code:02x}" if code < 256 else f"\\u{code:04x}"
    for code in (*_CONTROLS, *_DIRECTIONS)
}


def visible(text: str) -> str:
    """Return a text with what would move the cursor, or turn what is read, as escapes.

    Participants and recordings bring texts of others: no terminal obeys them. Line feeds and tabs
    stay.
    """
    return text.translate(_ESCAPES)


def say(text: str) -> None:
    """Print a line for people."""
    sys.stdout.write(visible(text) + "\n")
    sys.stdout.flush()


def print_error(text: str) -> None:
    """Print an error."""
    sys.stderr.write(f"stepbus: {visible(text)}\n")
    sys.stderr.flush()


def say_json(value: object) -> None:
    """Print a value for programs."""
    data = msgspec.json.format(msgspec.json.encode(value, enc_hook=os.fspath), indent=2)
    # JSON has escapes of its own, though not for all that terminals obey.
    text = data.decode().translate({code: f"\\u{code:04x}" for code in _ESCAPES})
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What a command has come to.

    value: for programs, with `--json`. lines: for people; tables of rich too. error: before them,
    on stderr. code: the exit code.
    """

    value: object
    lines: Iterable[object]
    error: str = ""
    code: int = 0

    def show(self, *, as_json: bool) -> int:
        """Print it, and return the exit code."""
        if as_json:
            say_json(self.value)
            return self.code
        if self.error:
            print_error(self.error)
        for line in self.lines:
            if isinstance(line, str):
                say(line)
            else:
                _print_table(line)
        return self.code


def _print_table(table: object) -> None:
    from rich.console import Console  # noqa: PLC0415  (most commands have none)

    # One that goes to a file or a pipe is not folded to the width of a terminal.
    Console(width=None if sys.stdout.isatty() else _PLAIN_COLUMNS).print(table)
