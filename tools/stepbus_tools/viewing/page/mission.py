"""What a mission says of its work: texts of several lines, of which columns become a table."""

import re
from collections.abc import Iterator, Sequence
from html import escape
from itertools import groupby

from stepbus_tools.viewing.history import TimelineEvent

_GAP = re.compile(r"\s{2,}")
_UNKNOWN = "-"
"""What a mission writes of a figure that it has not measured."""


def is_summary(event: TimelineEvent) -> bool:
    """Return whether an event is a text of several lines."""
    return "\n" in event.text


def summary_html(events: Sequence[TimelineEvent]) -> str:
    """Return the last text of each source: lines of equal columns as a table, others as text."""
    last = {event.source: event for event in events if is_summary(event)}
    return "".join(part for event in last.values() for part in _parts(event.text))


def _parts(text: str) -> Iterator[str]:
    rows = [_GAP.split(line.strip()) for line in text.splitlines() if line.strip()]
    for width, group in groupby(rows, key=len):
        lines = list(group)
        if width == 1:
            yield "".join(f"<p>{escape(row[0])}</p>" for row in lines)
        else:
            yield _table(_measured(lines))


def _measured(lines: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return a table without the columns that no row has measured."""
    kept = [
        number
        for number in range(len(lines[0]))
        if any(row[number] != _UNKNOWN for row in lines[1:]) or len(lines) == 1
    ]
    return [[row[number] for number in kept] for row in lines]


def _table(rows: Sequence[Sequence[str]]) -> str:
    """Return rows of texts as a table; the first one is its header.

    On a phone each row is a card, on which a cell says its column.
    """
    names, *body = rows
    head = "".join(f"<th>{escape(name)}</th>" for name in names)
    lines = "".join(
        "<tr>"
        + "".join(
            f'<td data-of="{escape(name)}">{escape(cell)}</td>'
            for name, cell in zip(names, row, strict=True)
        )
        + "</tr>"
        for row in body
    )
    return f"<div class=scroll tabindex=0><table class=cards><tr>{head}</tr>{lines}</table></div>"
