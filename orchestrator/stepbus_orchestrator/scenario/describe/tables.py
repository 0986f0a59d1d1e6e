"""Declared parameters as tables in Markdown."""

import inspect

from stepbus_participant import Settings

from .rows import Row, parts_of, rows_of

_HEAD = "| Key | Value | Default | Meaning |\n|---|---|---|---|\n"


def table(settings: type[Settings]) -> str:
    """Return the keys as a table."""
    return _HEAD + "".join(map(_line, rows_of(settings)))


def tables(settings: type[Settings]) -> str:
    """Return the keys as a table, followed by one for each map below."""
    parts: dict[type[Settings], str] = {}
    for path, part in parts_of(settings):
        parts.setdefault(part, path)
    texts = [f"\n`{path}`: {_summary(part)}\n\n{table(part)}" for part, path in parts.items()]
    return table(settings) + "".join(texts)


def _summary(settings: type[Settings]) -> str:
    text = inspect.cleandoc(settings.__doc__ or "").partition("\n\n")[0]
    return " ".join(text.split())


def _line(row: Row) -> str:
    cells = (f"`{row.key}`", row.value, row.default, row.meaning)
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |\n"
