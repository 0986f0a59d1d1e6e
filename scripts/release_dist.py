"""Build distributions of a commit, and look for files that they lack."""

import hashlib
import io
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).resolve().parents[1]
CLONE_ONLY = "clients/rust/tests/"

Files = Mapping[str, bytes]
"""Path → content."""


class Failed(Exception):
    """A check cannot be made: its message says what is wrong and where."""


def run(*command: str | Path, cwd: Path, patience_s: float = 300.0, **variables: str) -> str:
    """Return what a command prints on both streams; raises Failed with its last lines."""
    words = [str(word) for word in command]
    try:
        done = subprocess.run(
            words,
            check=False,
            cwd=cwd,
            env={**os.environ, **variables},
            text=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=patience_s,
        )
    except (subprocess.TimeoutExpired, OSError) as exc:
        raise Failed(f"`{' '.join(words)}`: {exc}") from None
    if done.returncode:
        last = "\n".join(done.stdout.splitlines()[-15:])
        raise Failed(f"`{' '.join(words)}` ends with exit code {done.returncode}:\n{last}")
    return done.stdout


def tracked_files(commit: str) -> dict[str, bytes]:
    """Return every file of a commit."""
    command = ["git", "archive", "--format=tar", commit]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    with tarfile.open(fileobj=io.BytesIO(done.stdout)) as archive:
        files = ((member.name, archive.extractfile(member)) for member in archive)
        return {name: file.read() for name, file in files if file is not None}


def check_out(files: Files, folder: Path) -> Path:
    """Write files into a folder; return it."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder


def build(files: Files, folder: Path, epoch: str, project: str) -> tuple[Path, Path, list[str]]:
    """Build a project of these files; return its sdist, its wheel, and what is wrong with them.

    The wheel is built twice, from the files and from the sdist, and must be the same bytes.
    epoch: SOURCE_DATE_EPOCH [s since 1970]. project: its folder, `.` for the root.
    """
    own = Layout(files, project)
    hatchling = (sys.executable, "-m", "hatchling", "build", "-d")
    out, clean = folder / "out", check_out(files, folder / "clean")
    run(*hatchling, out, cwd=clean / project, SOURCE_DATE_EPOCH=epoch)
    (sdist,), (wheel,) = out.glob("*.tar.gz"), out.glob("*.whl")
    with tarfile.open(sdist) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    (unpacked,) = (folder / "unpacked").iterdir()
    run(*hatchling, folder / "again", "-t", "wheel", cwd=unpacked, SOURCE_DATE_EPOCH=epoch)
    again = sha256(folder / "again" / wheel.name)
    problems = [] if again == sha256(wheel) else ["the sdist gives another wheel than a clean tree"]
    problems += [*own.problems_of_wheel(wheel), *own.problems_of_sdist(sdist)]
    return sdist, wheel, [f"{own.name} {own.version}: {line}" for line in problems]


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file, in hex."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


class Layout:
    """The expected contents of a project's distributions. project: its folder, `.` for the root."""

    def __init__(self, files: Files, project: str = ".") -> None:
        prefix = "" if project == "." else f"{project}/"
        self._files = {k.removeprefix(prefix): v for k, v in files.items() if k.startswith(prefix)}
        settings = tomllib.loads(self._files["pyproject.toml"].decode())
        self.name: str = settings["project"]["name"]
        self.version: str = settings["project"]["version"]
        self._targets = settings["tool"]["hatch"]["build"]["targets"]

    def _below(self, place: str) -> Iterator[str]:
        for name in self._files:
            is_below = name == place or name.startswith(f"{place}/")
            if is_below and not name.startswith(CLONE_ONLY):
                yield name

    def problems_of_wheel(self, path: Path) -> Iterator[str]:
        """Yield what is wrong with the contents of a wheel, a line each."""
        target = self._targets["wheel"]
        moved = target.get("sources", {})
        wanted = {
            moved.get(package, PurePosixPath(package).name) + name[len(package) :]
            for package in target["packages"]
            for name in self._below(package)
        }
        with zipfile.ZipFile(path) as archive:
            yield from _missing(wanted, archive.namelist())
            info = f"{self.name.replace('-', '_')}-{self.version}.dist-info/"
            page = archive.read(f"{info}METADATA").decode()
        if self.name == "stepbus":
            for link in re.findall(r"\]\((?![a-z]+:|#)([^)\s]+)\)", page):
                yield f"the page of the package has the relative link {link}"

    def problems_of_sdist(self, path: Path) -> Iterator[str]:
        """Yield the same of an sdist."""
        places = (*self._targets["sdist"]["only-include"], "pyproject.toml", "README.md", "LICENSE")
        wanted = {name for place in places for name in self._below(place)}
        with tarfile.open(path) as archive:
            yield from _missing(wanted, [name.partition("/")[2] for name in archive.getnames()])


def _missing(wanted: set[str], held: Sequence[str]) -> Iterator[str]:
    """Yield a line for each file that is missing; a clean tree has no others to be packed."""
    return (f"{name} is missing" for name in sorted(wanted.difference(held)))
