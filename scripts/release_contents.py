"""Check what a wheel and an sdist hold against what git has: nothing less, nothing more."""

import re
import tarfile
import tomllib
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath

CLONE_ONLY = ("/clients/rust/tests/",)
MOST_LINES = 12


class Layout:
    """The expected contents of a project's distributions. project: its folder, `.` for the root.

    files: path → content of every tracked file of the repository.
    """

    def __init__(self, files: Mapping[str, bytes], project: str = ".") -> None:
        prefix = "" if project == "." else f"{project}/"
        self._files = {
            name.removeprefix(prefix): content
            for name, content in files.items()
            if name.startswith(prefix)
        }
        settings = tomllib.loads(self._files["pyproject.toml"].decode())
        self.name: str = settings["project"]["name"]
        self.version: str = settings["project"]["version"]
        targets = settings["tool"]["hatch"]["build"]["targets"]
        self._packages: list[str] = targets["wheel"]["packages"]
        self._moved: dict[str, str] = targets["wheel"].get("sources", {})
        self._listed: list[str] = targets["sdist"]["only-include"]

    def wheel(self) -> dict[str, bytes]:
        """Return path → content of all that the wheel should hold, but for its metadata."""
        return {
            self._moved.get(package, PurePosixPath(package).name) + name[len(package) :]: content
            for package in self._packages
            for name, content in self._below(package)
        }

    def sdist(self) -> dict[str, bytes]:
        """Return the same of the sdist, without the folder that it unpacks to."""
        always = ("pyproject.toml", "README.md", "LICENSE")
        places = (*self._listed, *always)
        return {name: content for place in places for name, content in self._below(place)}

    def _below(self, place: str) -> Iterator[tuple[str, bytes]]:
        for name, content in self._files.items():
            if (name == place or name.startswith(f"{place}/")) and not any(
                f"/{name}".startswith(folder) for folder in CLONE_ONLY
            ):
                yield name, content


def read_wheel(path: Path) -> dict[str, bytes]:
    """Return name → content of the files of a wheel."""
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}


def read_sdist(path: Path) -> dict[str, bytes]:
    """Return the same of an sdist, without the folder that it unpacks to."""
    with tarfile.open(path) as archive:
        return {
            member.name.partition("/")[2]: file.read()
            for member in archive
            if (file := archive.extractfile(member)) is not None
        }


def problems_of_wheel(path: Path, layout: Layout) -> list[str]:
    """Return the problems of a wheel's contents, a line each."""
    held = read_wheel(path)
    info = f"{layout.name.replace('-', '_')}-{layout.version}.dist-info/"
    own = {name: content for name, content in held.items() if not name.startswith(info)}
    problems = [*_compared(own, layout.wheel())]
    if layout.name == "stepbus":
        metadata = held.get(f"{info}METADATA", b"").decode()
        problems += [
            f"the page of the package has the relative link {link}"
            for link in re.findall(r"\]\((?![a-z]+:|#)([^)\s]+)\)", metadata)
        ]
    return [f"{path.name}: {problem}" for problem in problems]


def problems_of_sdist(path: Path, layout: Layout) -> list[str]:
    """Return the problems of an sdist's contents, a line each."""
    held = read_sdist(path)
    own = {name: text for name, text in held.items() if name not in {"PKG-INFO", ".gitignore"}}
    return [f"{path.name}: {problem}" for problem in _compared(own, layout.sdist())]


def _compared(held: Mapping[str, bytes], wanted: Mapping[str, bytes]) -> Iterator[str]:
    """Yield a line for each file that is missing, stray or changed; not more than a screen."""
    lines = [f"{name} is missing" for name in sorted(wanted.keys() - held.keys())]
    lines += [
        f"{name} is not a tracked file of a package" for name in sorted(held.keys() - wanted.keys())
    ]
    lines += [
        f"{name} differs from the tracked file"
        for name in sorted(wanted.keys() & held.keys())
        if held[name] != wanted[name]
    ]
    yield from lines[:MOST_LINES]
    if len(lines) > MOST_LINES:
        yield f"and {len(lines) - MOST_LINES} more"
