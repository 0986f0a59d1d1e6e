"""Try stepbus on each Python of this machine, as its users install it: from an empty environment.

    make pythons                            3.12 and later, of pyenv and on PATH
    make pythons PYTHONS='--from 3.11'      3.11 too, the one with PyBullet

For each, it makes a virtual environment in a temporary folder, installs `.[sim,report]`, runs
`two_link`, and prints how long it took to the first plot. It fails where one of them has no plot,
and where there is none to try.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from scripts.release_build import ROOT, Failed, Timer, run

PATIENCE_S = 900.0
PATIENCE_TO_ASK_S = 30.0
Version = tuple[int, ...]


def main(words: Sequence[str]) -> int:
    """Try each Python; return how many have failed."""
    parser = argparse.ArgumentParser(prog="make pythons", description=__doc__.splitlines()[0])
    parser.add_argument("--from", dest="since", default="3.12", metavar="X.Y", help="the oldest")
    pythons = found(tuple(map(int, parser.parse_args(words).since.split("."))))
    if not pythons:
        sys.stdout.write("no such Python found, neither in pyenv nor on PATH\n")
        return 1
    failures = 0
    for version, path in sorted(pythons.items()):
        name, timer = "Python " + ".".join(map(str, version)), Timer()
        try:
            engine = _try(path)
            said = f"{name}: {timer} to the first plot, with {engine}"
        except Failed as exc:
            failures += 1
            said = f"{name} ({path}) failed: {exc}"
        sys.stdout.write(f"{said}\n")
        sys.stdout.flush()
    return failures


def found(oldest: Version) -> dict[Version, str]:
    """Return version → interpreter of each Python from `oldest` on, the first that works."""
    found: dict[Version, str] = {}
    for path in _candidates():
        version = _asked(path)
        if version >= oldest:
            found.setdefault(version, path)
    return found


def _candidates() -> Iterator[str]:
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    yield from map(str, sorted(root.glob("versions/3.*/bin/python3"), reverse=True))
    names = ("python3", *(f"python3.{minor}" for minor in range(11, 30)))
    yield from filter(None, map(shutil.which, names))


def _asked(python: str) -> Version:
    """Return the version of an interpreter; empty where it does not work, as some of pyenv's."""
    program = "import sys, venv, ensurepip; print(*sys.version_info[:2])"
    try:
        done = subprocess.run(
            [python, "-c", program],
            check=True,
            capture_output=True,
            text=True,
            timeout=PATIENCE_TO_ASK_S,
        )
    except (OSError, subprocess.SubprocessError):
        return ()
    return tuple(map(int, done.stdout.split()))


def _try(python: str) -> str:
    """Return the engine of a Python whose first plot is made; raises Failed."""
    with tempfile.TemporaryDirectory(prefix="stepbus-python-") as name:
        folder = Path(name)
        programs = folder / "env/bin"
        run(python, "-m", "venv", "env", cwd=folder)
        pip = ("-m", "pip", "install", "-q", "--disable-pip-version-check")
        pinned = ("-c", ROOT / "constraints.txt", f"{ROOT}[sim,report]")
        run(programs / "python", *pip, *pinned, cwd=folder, patience_s=PATIENCE_S)
        run(programs / "stepbus", "run", "two_link", "--out", "run", cwd=folder)
        if not (folder / "run/report.png").is_file():
            raise Failed("the run has no report.png")
        program = "from stepbus_plant.engines import default_engine; print(default_engine())"
        return run(programs / "python", "-c", program, cwd=folder).strip()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
