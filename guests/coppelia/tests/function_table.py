"""The table of functions in docs/guide/writing/coppeliasim.md: `python function_table.py` writes it."""

import re
from pathlib import Path

from stepbus_coppelia.functions import GROUPS

PAGE = Path(__file__).parents[3] / "docs/guide/writing/coppeliasim.md"
BEGIN, END = "<!-- functions -->\n", "<!-- /functions -->"


def table():
    """Return the table, made from the classes that implement the functions."""
    lines = ["| Function | What it does |", "|---|---|"]
    for group in GROUPS:
        lines.append(f"| *{group.title}* | |")
        names = {}
        for name, work in group.names().items():
            names.setdefault(work, []).append(f"`{name}`")
        for work, rows in names.items():
            text = getattr(group, work).__doc__.split("\n")[0]
            lines.append(f"| {', '.join(rows)} | {text} |")
    return "\n".join(lines) + "\n"


def written(page):
    """Return the page with the table as it is now."""
    pattern = re.escape(BEGIN) + ".*?" + re.escape(END)
    return re.sub(pattern, lambda _: BEGIN + table() + END, page, flags=re.DOTALL)


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text()))
