"""What differs between two states of a scenario and its files, as a unified diff."""

import difflib
from collections.abc import Iterator, Mapping, Sequence
from itertools import zip_longest

import msgspec

_MOST_LINES = 5000
"""Of all files together: to match more takes minutes where their lines are alike."""
_MOST_CHARACTERS = 400


class FileChange(msgspec.Struct, frozen=True, kw_only=True):
    """One file that differs.

    line: the first line of the second file that differs; 0: only one side has the file, or it is no
    text. what: how it differs, in words; diff: lines of a unified diff; empty: there is none.
    """

    name: str
    line: int = 0
    what: str = ""
    diff: Sequence[str] = ()

    @property
    def place(self) -> str:
        """Return where it differs: `controller.py:12`."""
        return f"{self.name}:{self.line}" if self.line else self.name

    def lines(self) -> Iterator[str]:
        """Yield it as text."""
        if self.what:
            yield f"{self.place}: {self.what}"
        yield from self.diff


def changes(
    first: Mapping[str, bytes],
    second: Mapping[str, bytes],
    sides: tuple[str, str] = ("first", "second"),
) -> list[FileChange]:
    """Return how the files of two sides, by name, differ. sides: what both are called."""
    left, found = _MOST_LINES, []
    for key in sorted({*first, *second}):
        one, other = first.get(key), second.get(key)
        name = key if key.isprintable() else ascii(key)
        if one is None or other is None:
            side, content = (sides[1], other) if one is None else (sides[0], one)
            what = f"only in the {side} ({len(content or b'')} bytes)"
            found.append(FileChange(name=name, what=what))
        elif one != other:
            change, used = _change(name, one, other, sides, left)
            left -= used
            found.append(change)
    return found


def _change(
    name: str, one: bytes, other: bytes, sides: tuple[str, str], most: int
) -> tuple[FileChange, int]:
    """Return how a file differs, and how many lines were matched; most: of them."""
    old, new = _lines(one), _lines(other)
    if old is None or new is None:
        what = f"no text; {len(one)} bytes in the {sides[0]}, {len(other)} in the {sides[1]}"
        return FileChange(name=name, what=what), 0
    size, pairs = max(len(old), len(new)), enumerate(zip_longest(old, new), 1)
    line = next((number for number, (was, now) in pairs if was != now), size)
    if size > most:
        what = f"{size} lines are too many for a diff"
        return FileChange(name=name, line=line, what=what), 0
    before, after = (f"{side}/{name}" for side in sides)
    shown = difflib.unified_diff(old, new, before, after, lineterm="")
    return FileChange(name=name, line=line, diff=[*map(_cut, shown)]), size


def _lines(content: bytes) -> list[str] | None:
    """Return the lines of a text; None of any other content."""
    try:
        text = content.decode()
    except UnicodeDecodeError:
        return None
    if "\0" in text:
        return None
    lines = text.removesuffix("\n").split("\n") if text else []
    return lines if text[-1:] in {"", "\n"} else [*lines, "\\ no newline at the end"]


def _cut(line: str) -> str:
    rest = len(line) - _MOST_CHARACTERS
    return line if rest <= 0 else f"{line[:_MOST_CHARACTERS]} … ({rest} more characters)"
