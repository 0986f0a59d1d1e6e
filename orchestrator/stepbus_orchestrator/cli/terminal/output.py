"""Where the command line prints, and what a command has come to."""

import os
import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import IO, TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from rich.table import Table

_PLAIN_COLUMNS = 200
_PATIENCE_S = 2.0
_RED, _PLAIN = "\x1b[1;31m", "\x1b[0m"
INDENT = "    "
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


def has_screen(stream: IO[str]) -> bool:
    """Return whether a stream is a terminal that can draw a line again."""
    # By descriptor: while a live display is on, Rich stands in for sys.stdout; and with FORCE_COLOR
    # Rich takes any stream for a terminal.
    try:
        return os.isatty(stream.fileno()) and os.environ.get("TERM") != "dumb"
    except (OSError, ValueError):
        return False


class ReadingLine:
    """Shows in one line of the standard error how far a long recording has been read."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._now_s = clock
        self._due_s: float | None = None
        self._is_shown = False

    def __call__(self, path: Path, share: float) -> None:
        """Show how much of it is read (0 to 1); 1: all, and the line goes."""
        now_s = self._now_s()
        if share == 1.0:
            sys.stderr.write("\r\x1b[K" * self._is_shown)
            sys.stderr.flush()
            self._due_s, self._is_shown = None, False
        elif self._due_s is None:
            self._due_s = now_s + _PATIENCE_S
        elif now_s >= self._due_s:
            sys.stderr.write(f"\rreading {visible(str(path))}: {share:.0%}\x1b[K")
            sys.stderr.flush()
            self._due_s, self._is_shown = now_s + 0.5, True


def columns() -> int:
    """Return the width of the terminal, 80 where there is none."""
    return shutil.get_terminal_size().columns


def fold(text: str, width: int, indent: str = "") -> str:
    """Return a text with lines that are too long broken between words, never within one.

    indent: of the lines that continue another one, beside its own.
    """

    def folded(line: str) -> str:
        own = line[: len(line) - len(line.lstrip())]
        # A long word, such as a path, is better broken by the terminal: it can be copied whole.
        wrap = textwrap.TextWrapper(
            width,
            subsequent_indent=own + indent,
            break_long_words=False,
            break_on_hyphens=False,
        )
        return line if len(line) <= width else wrap.fill(line)

    return "\n".join(map(folded, text.split("\n")))


def write(stream: IO[str], text: str, *, red: int = 0) -> None:
    """Write a text for people, folded to the width of a terminal.

    What goes to a file or a program is one line, however long. red: how many of its first
    characters are red, where the terminal may have colours (no-color.org).
    """
    shown = visible(text)
    if has_screen(stream):
        shown = fold(shown, columns(), INDENT)
        if red and not os.environ.get("NO_COLOR"):
            shown = f"{_RED}{shown[:red]}{_PLAIN}{shown[red:]}"
    stream.write(shown)
    stream.flush()


def say(text: str) -> None:
    """Print a line for people."""
    write(sys.stdout, f"{text}\n")


def print_error(text: str, who: str = "stepbus") -> None:
    """Print an error. who: says it, in red on a terminal."""
    write(sys.stderr, f"{who}: {text}\n", red=len(who) + 1)


def say_json(value: object) -> None:
    """Print a value for programs."""
    import msgspec  # noqa: PLC0415  (the overview of commands has no need of it)

    data = msgspec.json.format(msgspec.json.encode(value, enc_hook=os.fspath), indent=2)
    # JSON has escapes of its own, though not for all that terminals obey.
    text = data.decode().translate({code: f"\\u{code:04x}" for code in _ESCAPES})
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


class Answer(NamedTuple):
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
                from rich.console import Console  # noqa: PLC0415  (most commands have none)

                # One that goes to a file or a pipe is not folded to the width of a terminal.
                Console(width=None if sys.stdout.isatty() else _PLAIN_COLUMNS).print(line)
        return self.code


def table(*columns: str, right: Collection[str] = ()) -> "Table":
    """Return a table, narrow enough for most terminals. right: columns of numbers."""
    from rich.box import SIMPLE_HEAD  # noqa: PLC0415  (most commands have none)
    from rich.table import Table  # noqa: PLC0415

    made = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False, collapse_padding=True)
    for column in columns:
        made.add_column(column, justify="right" if column in right else "left", overflow="fold")
    return made
