"""What a mission says of its work: texts of several lines, of which columns become a table."""

import re
from collections.abc import Iterator, Sequence
from html import escape
from itertools import groupby

from stepbus_tools.viewing.history import TimelineEvent

from .tables import table_html

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
            yield table_html(_measured(lines))


def _measured(lines: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return a table without the columns that no row has measured."""
    kept = [
        number
        for number in range(len(lines[0]))
        if any(row[number] != _UNKNOWN for row in lines[1:]) or len(lines) == 1
    ]
    return [[row[number] for number in kept] for row in lines]
