"""What installed packages add by entry points: commands, views, what follows a run.

The core names no tool: it asks for a group, and the installed tools answer.
"""

from functools import cache
from typing import TYPE_CHECKING, Any, Protocol

from stepbus_participant import ExtraMissing

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint
    from pathlib import Path

COMMANDS = "stepbus.commands"
"""name → a `Command` of the command line."""
VIEWS = "stepbus.views"
"""What shows a recording or a result where the core is asked to: in a notebook, of variants."""
AFTER_RUN = "stepbus.after_run"
"""`(recording, *, has_plots) -> lines` of the summary; the CLI calls them when a run has ended."""
RERUNS = "stepbus.reruns"
"""The file that marks a folder → what repeats a numbered run of it."""

_FILE = "entry_points.txt"


class Plot(Protocol):
    """A picture of signals, as `Recording.plot` returns it; a notebook shows it."""

    @property
    def png(self) -> bytes:
        """Return its bytes."""
        ...

    def save(self, path: "str | Path") -> "Path":
        """Write it as a PNG file; raises RecordingFailed when it cannot be written."""
        ...


def points(group: str) -> "list[EntryPoint]":
    """Return the entry points of a group, in the order of their names."""
    return sorted(point for point in all_points() if point.group == group)


def named_points(group: str) -> "dict[str, EntryPoint]":
    """Return name → entry point of a group; of several with one name, the first by its value."""
    first: dict[str, EntryPoint] = {}
    for point in points(group):
        first.setdefault(point.name, point)
    return first


@cache
def all_points() -> "frozenset[EntryPoint]":
    """Return the entry points of all groups of stepbus; installed packages are looked at once."""
    # It takes longer to load than all else here, and only some commands need it.
    from importlib.metadata import distributions  # noqa: PLC0415

    # To parse the others as well takes twice as long.
    ours = (one for one in distributions() if "[stepbus." in (one.read_text(_FILE) or ""))
    return frozenset(point for one in ours for point in one.entry_points)


def view(name: str) -> Any:
    """Return a view by name; raises ExtraMissing when no installed package has it."""
    point = named_points(VIEWS).get(name)
    if point is None:
        raise ExtraMissing(
            f"no installed package has the view {name!r} (entry points of the group {VIEWS!r}); "
            "was stepbus installed with pip?"
        )
    return point.load()
