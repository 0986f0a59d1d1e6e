"""Build a distribution from a clean tree and from its sdist, and compare the bytes."""

import hashlib
import io
import os
import shutil
import subprocess
import sys
import tarfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PATIENCE_S = 300.0
LAST_LINES = 15


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


def check_out(files: dict[str, bytes], folder: Path) -> Path:
    """Write files into a folder; return it."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder


def build(project: Path, out: Path, epoch: str, *targets: str) -> Built:
    """Build the targets (`sdist`, `wheel`; default: both) of a project folder into `out`."""
    chosen = [word for target in targets or ("sdist", "wheel") for word in ("-t", target)]
    command = (sys.executable, "-m", "hatchling", "build", "-d", out, *chosen)
    run(*command, cwd=project, SOURCE_DATE_EPOCH=epoch)
    return Built(*(_only(out, pattern) for pattern in ("*.tar.gz", "*.whl")))


def _only(folder: Path, pattern: str) -> Path:
    found = sorted(folder.glob(pattern))
    if len(found) > 1:
        raise Failed(f"{folder} holds {len(found)} files {pattern}; expected one")
    return found[0] if found else folder / pattern


def build_twice(
    files: dict[str, bytes], folder: Path, epoch: str, name: str
) -> tuple[Built, Built]:
    """Return two builds of a project: from its files, and of the wheel from its sdist.

    name: of the project's folder in the repository; `.` is the root.
    """
    clean = check_out(files, folder / "clean")
    first = build(clean / name, folder / "first", epoch)
    unpacked = folder / "unpacked"
    with tarfile.open(first.sdist) as archive:
        archive.extractall(unpacked, filter="data")
    (project,) = unpacked.iterdir()
    second = build(project, folder / "second", epoch, "wheel")
    for place in (clean, unpacked):
        shutil.rmtree(place)
    return first, second


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file, in hex."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def differences(clean: Built, from_sdist: Built) -> list[str]:
    """Return a line where the wheel of the sdist differs from that of the clean tree."""
    wanted, got = sha256(clean.wheel), sha256(from_sdist.wheel)
    text = f"{clean.wheel.name}: the sdist gives {got[:12]}…, a clean tree gives {wanted[:12]}…"
    return [] if got == wanted else [text]


class Timer:
    """How long something has taken."""

    def __init__(self) -> None:
        self._began_s = time.monotonic()

    def __str__(self) -> str:
        """Return the time since it was made, such as `12 s`."""
        return f"{time.monotonic() - self._began_s:.0f} s"
