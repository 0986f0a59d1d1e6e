"""Try stepbus on each Python of this machine, as its users install it: from an empty environment.

    make pythons                                        3.12 and later, of pyenv and on PATH
    make pythons PYTHONS='--from 3.11'                  3.11 too, the one with PyBullet
    make pythons PYTHONS='--only 3.13 --tests tests/services'   then these tests too

For each, it makes a virtual environment in a temporary folder, installs `.[sim,report]`, runs
`two_link`, and prints how long it took to the first plot, and with how much processor time. It
fails where one of them has no plot, and where there is none to try.
"""

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OLDEST, NEWEST_MINOR = (3, 12), 30
PATIENCE_S = 900.0
TESTS_PATIENCE_S = 3600.0
PATIENCE_TO_ASK_S = 30.0
LAST_LINES = 15
Version = tuple[int, ...]


class Failed(Exception):
    """A command that should have worked did not; says how it ended."""


def main(words: Sequence[str]) -> int:
    """Try each Python; return how many have failed."""
    options = _options(words)
    oldest = _version(options.since)
    pythons = {
        version: path
        for version, path in found(oldest).items()
        if options.only is None or version == _version(options.only)
    }
    if not pythons:
        sys.stdout.write("no such Python found, neither in pyenv nor on PATH\n")
        return 1
    failures = 0
    for version, path in sorted(pythons.items()):
        name = "Python " + ".".join(map(str, version))
        try:
            said = f"{name}: {_try(path, options.tests)}"
        except Failed as exc:
            failures += 1
            said = f"{name} ({path}) failed: {exc}"
        sys.stdout.write(f"{said}\n")
        sys.stdout.flush()
    return failures


def _options(words: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make pythons", description=__doc__.splitlines()[0])
    default = ".".join(map(str, OLDEST))
    parser.add_argument("--from", dest="since", default=default, metavar="X.Y", help="the oldest")
    parser.add_argument("--only", metavar="X.Y", help="try only this version")
    parser.add_argument("--tests", metavar="PATH", help="also run these tests, with `.[dev]`")
    return parser.parse_args(words)


def _version(text: str) -> Version:
    try:
        return tuple(map(int, text.split(".")))
    except ValueError:
        sys.exit(f"make pythons: {text!r} is not a version such as 3.13")


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
    names = ("python3", *(f"python3.{minor}" for minor in range(OLDEST[1] - 1, NEWEST_MINOR)))
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


def _try(python: str, tests: str | None) -> str:
    """Return what to say of a Python; raises Failed."""
    with tempfile.TemporaryDirectory(prefix="stepbus-python-") as name:
        folder = Path(name)
        start_s, start_cpu_s = time.monotonic(), _cpu_s()
        _run(folder, python, "-m", "venv", "env")
        own = str(folder / "env/bin/python")
        pip = ("-m", "pip", "install", "-q", "--disable-pip-version-check")
        pip = (*pip, "-c", str(ROOT / "constraints.txt"))
        _run(folder, own, *pip, f"{ROOT}[sim,report]")
        _run(folder, str(folder / "env/bin/stepbus"), "run", "two_link", "--out", "run")
        if not (folder / "run/report.png").is_file():
            raise Failed("the run has no report.png")
        took_s, cpu_s = time.monotonic() - start_s, _cpu_s() - start_cpu_s
        program = "from stepbus_plant.engines import default_engine; print(default_engine())"
        engine = _run(folder, own, "-c", program).strip()
        said = f"{took_s:.0f} s ({cpu_s:.0f} s of processor time) to the first plot, with {engine}"
        if tests is not None:
            _run(folder, own, *pip, "-e", f"{ROOT}[dev]")
            words = ("-m", "pytest", "-n", "2", tests)
            said += f"; {_run(ROOT, own, *words, patience_s=TESTS_PATIENCE_S).splitlines()[-1]}"
        return said


def _run(folder: Path, *command: str, patience_s: float = PATIENCE_S) -> str:
    """Return what a command prints; raises Failed with its last lines."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    try:
        done = subprocess.run(
            command, check=False, cwd=folder, text=True, timeout=patience_s, **pipes
        )
    except subprocess.TimeoutExpired:
        raise Failed(f"`{' '.join(command)}` took over {patience_s:g} s") from None
    if done.returncode:
        last = "\n".join(done.stdout.splitlines()[-LAST_LINES:])
        raise Failed(f"`{' '.join(command)}` ended with {done.returncode}:\n{last}")
    return done.stdout


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
