"""Tables of a page: on a phone each row is a card, on which a cell says its column."""

from collections.abc import Sequence
from html import escape


def table_html(rows: Sequence[Sequence[str]]) -> str:
    """Return rows of texts as a table; the first one is its header."""
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
