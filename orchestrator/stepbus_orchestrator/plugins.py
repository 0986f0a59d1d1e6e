"""What installed packages add by entry points: commands, views, what follows a run.

The core names no tool: it asks for a group, and the installed tools answer.
"""

import os
import sys
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

if TYPE_CHECKING:
    from pathlib import Path

COMMANDS = "stepbus.commands"
"""name → a `Command` of the command line, a class."""
VIEWS = "stepbus.views"
"""What shows a recording or a result where the core is asked to: in a notebook, of variants."""
AFTER_RUN = "stepbus.after_run"
"""`(recording, *, has_plots) -> lines` of the summary; the CLI calls them when a run has ended."""
RERUNS = "stepbus.reruns"
"""The file that marks a folder → `(folder, number) -> run`: a `Recorded` with a method `run`."""

OVERLAYS = "stepbus.overlays"
"""Message type → `(viser scene, path, message, poses) -> handles` of what a page shows of it."""

SCENARIO_FILES = "stepbus.scenario_files"
"""Ending, such as `.fmu` → `(path) -> data` of the scenario that such a file stands for."""
STARTERS = "stepbus.starters"
"""Ending, such as `.fmu` → `(path, name) -> files` of what `stepbus new` makes of such a file."""
HOSTS = "stepbus.hosts"
"""`(scenario, hosts, listen) -> (elsewhere, extension)`: what takes a run to other hosts."""
CHECKS = "stepbus.checks"
"""`(hosts, listen) -> rows`, each (what, `ok`, `warn` or `fail`, text), for `stepbus doctor`."""
ABOUT = "stepbus.about"
"""A participant's class → `(participant, scenario) -> lines` that `stepbus describe` adds."""

_FILE = "entry_points.txt"


class CommandBroken(Exception):
    """A command of another package cannot be loaded."""


class Plot(Protocol):
    """A picture of signals, as `Recording.plot` returns it; a notebook shows it."""

    @property
    def png(self) -> bytes:
        """Return its bytes."""
        ...

    def save(self, path: "str | Path") -> "Path":
        """Write it as a PNG file; raises RecordingFailed when it cannot be written."""
        ...


class EntryPoint(NamedTuple):
    """What a package adds to a group. value: `module:attribute`."""

    name: str
    value: str
    group: str

    def load(self) -> Any:
        """Import it; raises ImportError or AttributeError where it is not there."""
        module, _, attributes = self.value.partition("[")[0].partition(":")
        loaded: Any = import_module(module.strip())
        for attribute in filter(None, attributes.strip().split(".")):
            loaded = getattr(loaded, attribute)
        return loaded


def points(group: str) -> list[EntryPoint]:
    """Return the entry points of a group, in the order of their names."""
    return sorted(point for point in all_points() if point.group == group)


def named_points(group: str) -> dict[str, EntryPoint]:
    """Return name → entry point of a group; of several with one name, the first by its value."""
    first: dict[str, EntryPoint] = {}
    for point in points(group):
        first.setdefault(point.name, point)
    return first


@cache
def all_points() -> frozenset[EntryPoint]:
    """Return the entry points of all groups of stepbus; installed packages are looked at once.

    As of `importlib.metadata`, which takes ten times as long: 45 ms, at every start.
    """
    # To parse the others as well takes twice as long.
    return frozenset(point for text in _texts() if "[stepbus." in text for point in _parsed(text))


def metadata_folders() -> Iterator[str]:
    """Yield the folders on `sys.path` that describe installed packages."""
    for place in sys.path:
        try:
            names = os.listdir(place or os.curdir)  # noqa: PTH208  (five times as quick)
        except OSError:
            continue
        ours = (name for name in names if name.endswith((".dist-info", ".egg-info")))
        yield from (f"{place}/{name}" if place else name for name in ours)


def _texts() -> Iterator[str]:
    for folder in metadata_folders():
        try:
            with open(f"{folder}/{_FILE}", encoding="utf-8") as file:  # noqa: PTH123  (likewise)
                yield file.read()
        except OSError:
            # Most packages have none.
            continue


def _parsed(text: str) -> Iterator[EntryPoint]:
    group = ""
    for line in map(str.strip, text.splitlines()):
        if line.startswith("[") and line.endswith("]"):
            group = line[1:-1]
        elif line and not line.startswith("#"):
            name, _, value = line.partition("=")
            yield EntryPoint(name.strip(), value.strip(), group)


def scenario_reader(file: str) -> "Callable[[Path], dict[str, Any]] | None":
    """Return what makes scenarios of files with the ending of this one; None of any other."""
    name = os.path.splitext(file)[1]  # noqa: PTH122  (a name need not be a path)
    point = named_points(SCENARIO_FILES).get(name) if name else None
    return None if point is None else point.load()


def view(name: str) -> Any:
    """Return a view by name; raises ExtraMissing when no installed package has it."""
    point = named_points(VIEWS).get(name)
    if point is None:
        # The overview of commands needs no other package.
        from stepbus_participant import ExtraMissing  # noqa: PLC0415

        raise ExtraMissing(
            f"no installed package provides the view {name!r} (entry points of the group "
            f"{VIEWS!r}); was stepbus installed with pip?"
        )
    return point.load()
