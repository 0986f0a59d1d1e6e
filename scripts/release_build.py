"""Build a distribution twice, in unlike surroundings, and compare the bytes."""

import hashlib
import io
import os
import shutil
import subprocess
import sys
import tarfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PATIENCE_S = 300.0
LAST_LINES = 15
LITTER = (
    ".venv/lib/left.py",
    "runs/left/run.mcap",
    "build/left.txt",
    "dist/stepbus-0.0.1.tar.gz",
    "api/stepbus/__pycache__/left.cpython-311.pyc",
    "orchestrator/stepbus_orchestrator/__pycache__/left.cpython-311.pyc",
    "clients/rust/target/release/left.so",
    "clients/rust/Cargo.lock",
    "examples/controllers/c/controller",
    "examples/controllers/c/__pycache__/left.pyc",
    "store/stepbus_store/__pycache__/left.cpython-311.pyc",
)
"""What work in a clone leaves there; no distribution may hold it."""


class Failed(Exception):
    """A check cannot be made: its message is one line, what is wrong and where."""


@dataclass(frozen=True)
class Built:
    """The two files of a distribution."""

    sdist: Path
    wheel: Path

    @property
    def files(self) -> tuple[Path, Path]:
        """Return both."""
        return self.sdist, self.wheel


def run(*command: str | Path, cwd: Path, patience_s: float = PATIENCE_S, **variables: str) -> str:
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
    except subprocess.TimeoutExpired:
        raise Failed(f"`{' '.join(words)}` takes longer than {patience_s:g} s") from None
    except OSError as exc:
        raise Failed(f"`{' '.join(words)}` does not start: {exc}") from exc
    if done.returncode:
        last = "\n".join(done.stdout.splitlines()[-LAST_LINES:])
        raise Failed(f"`{' '.join(words)}` ends with exit code {done.returncode}:\n{last}")
    return done.stdout


def commit_of_head() -> tuple[str, str]:
    """Return the hash of HEAD and its time [s since 1970], which is SOURCE_DATE_EPOCH."""
    commit, epoch = run("git", "log", "-1", "--format=%H %ct", cwd=ROOT).split()
    return commit, epoch


def tracked_files(commit: str) -> dict[str, bytes]:
    """Return path → content of every file of a commit."""
    command = ["git", "archive", "--format=tar", commit]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    with tarfile.open(fileobj=io.BytesIO(done.stdout)) as archive:
        return {
            member.name: file.read()
            for member in archive
            if member.isfile() and (file := archive.extractfile(member)) is not None
        }


def check_out(files: dict[str, bytes], folder: Path, *, is_littered: bool) -> Path:
    """Write files into a folder; with the litter of a clone in use and other times and modes."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        if is_littered:
            path.chmod(0o600)
            os.utime(path, (1_000_000_000, 1_000_000_000))
    for name in LITTER if is_littered else ():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"left")
    return folder


def build(project: Path, out: Path, epoch: str, *targets: str, **variables: str) -> Built:
    """Build the targets (`sdist`, `wheel`; default: both) of a project folder into `out`."""
    chosen = [word for target in targets or ("sdist", "wheel") for word in ("-t", target)]
    command = (sys.executable, "-m", "hatchling", "build", "-d", out, *chosen)
    run(*command, cwd=project, SOURCE_DATE_EPOCH=epoch, **variables)
    return Built(*(_only(out, pattern) for pattern in ("*.tar.gz", "*.whl")))


def _only(folder: Path, pattern: str) -> Path:
    found = sorted(folder.glob(pattern))
    if len(found) > 1:
        raise Failed(f"{folder} holds {len(found)} files {pattern}; expected one")
    return found[0] if found else folder / pattern


def build_twice(files: dict[str, bytes], folder: Path, epoch: str, name: str) -> Iterator[Built]:
    """Yield three builds of a project: in a clean tree, in one in use, and from the sdist.

    name: of the project's folder in the repository; `.` is the root.
    """
    clean = check_out(files, folder / "clean", is_littered=False)
    first = build(clean / name, folder / "first", epoch)
    yield first
    used = check_out(files, folder / "some where/else" / "in use", is_littered=True)
    surroundings = {"TZ": "Asia/Tokyo", "LC_ALL": "C", "PYTHONHASHSEED": "7", "HOME": str(folder)}
    before = os.umask(0o077)
    try:
        yield build(used / name, folder / "second", epoch, **surroundings)
    finally:
        os.umask(before)
    unpacked = folder / "unpacked"
    with tarfile.open(first.sdist) as archive:
        archive.extractall(unpacked, filter="data")
    (project,) = unpacked.iterdir()
    yield build(project, folder / "third", epoch, "wheel")
    for place in (clean, used, unpacked):
        shutil.rmtree(place)


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file, in hex."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def differences(builds: dict[str, Path]) -> list[str]:
    """Return a line for each file that differs from the first one; name of the build → file."""
    (first, one), *others = builds.items()
    wanted = sha256(one)
    return [
        f"{one.name}: {name} gives {got[:12]}…, {first} gives {wanted[:12]}…"
        for name, other in others
        if (got := sha256(other)) != wanted
    ]


class Timer:
    """How long something has taken."""

    def __init__(self) -> None:
        self._began_s = time.monotonic()

    def __str__(self) -> str:
        """Return the time since it was made, such as `12 s`."""
        return f"{time.monotonic() - self._began_s:.0f} s"
