"""Full disks, files that another process removes, cuts or replaces, and limits of `ulimit`."""

from __future__ import annotations

import contextlib
import os
import random
import resource
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

from campaign.sandbox import Sandbox

from .fault import START_S, Missed, Strike
from .signals import stopped

_LIMIT_BYTES = 1 << 20
_MCAP_END = b"\x89MCAP0\r\n"


def while_running(strike: Strike) -> Strike:
    """Return the strike at an orchestrator that is stopped meanwhile, so that no run ends before.

    One that has written its recording whole has been missed.
    """

    def at_rest(box: Sandbox, chance: random.Random) -> None:
        with stopped(box.orchestrator):
            if _is_written(box.out / "run.mcap"):
                raise Missed
            strike(box, chance)

    return at_rest


def _is_written(recording: Path) -> bool:
    try:
        with recording.open("rb") as file:
            file.seek(-len(_MCAP_END), os.SEEK_END)
            return file.read() == _MCAP_END and file.tell() > len(_MCAP_END)
    except OSError:
        return False


def small_disk(box: Sandbox, chance: random.Random) -> Callable[[], None] | None:
    """Put the run's folder on a small file system, or limit the size of its files."""
    # A sale is over before it has filled a large one.
    kib = chance.randrange(700, 6000 if "planner" not in box.notes["participants"] else 1200)
    return _disk(box, f"size={kib}k", kib * 1024)


def own_disk(box: Sandbox, _chance: random.Random) -> Callable[[], None] | None:
    """Put the run's folder on a file system of its own, of 8 MB."""
    return _disk(box, "size=8m", _LIMIT_BYTES)


def few_inodes(box: Sandbox, chance: random.Random) -> Callable[[], None] | None:
    """Put the run's folder on a file system that takes a few files only."""
    return _disk(box, f"size=64m,nr_inodes={chance.randrange(2, 14)}", _LIMIT_BYTES)


def small_temporary_disk(box: Sandbox, chance: random.Random) -> Callable[[], None] | None:
    """Leave hardly any room for temporary files."""
    mount(box.temporary, f"size={4 * chance.randrange(1, 12)}k")
    return None


def _disk(box: Sandbox, options: str, otherwise_bytes: int) -> Callable[[], None] | None:
    if mount(box.home / "disk", options):
        return None
    return limit(resource.RLIMIT_FSIZE, otherwise_bytes)


def mount(folder: Path, options: str) -> bool:
    """Mount a file system in memory; return whether this user may."""
    command = ["mount", "-t", "tmpfs", "-o", options, "none", str(folder)]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


@while_running
def fill(box: Sandbox, _chance: random.Random) -> None:
    """Take the space of the run's folder away while it runs."""
    with contextlib.suppress(OSError), (box.home / "disk" / "ballast").open("wb") as file:
        while True:
            file.write(bytes(4096))
            file.flush()


@while_running
def move_folder(box: Sandbox, _chance: random.Random) -> None:
    """Move the run's folder away."""
    with contextlib.suppress(OSError):
        box.out.rename(box.out.with_name("elsewhere"))


@while_running
def remove_logs(box: Sandbox, _chance: random.Random) -> None:
    """Remove the participants' logs."""
    shutil.rmtree(box.out / "logs", ignore_errors=True)


def remove_temporary_files(box: Sandbox, _chance: random.Random) -> None:
    """Remove the private folder, with the sockets in it."""
    box.wait_for(lambda: [*box.temporary.glob("stepbus-*")], START_S)
    for folder in box.temporary.glob("stepbus-*"):
        shutil.rmtree(folder, ignore_errors=True)


@while_running
def cut(box: Sandbox, chance: random.Random) -> None:
    """Cut the recording to a random size."""
    with contextlib.suppress(OSError):
        size = (box.out / "run.mcap").stat().st_size
        os.truncate(box.out / "run.mcap", chance.randrange(size + 1))


def replace(name: str) -> Strike:
    """Return a strike that puts something else into the place of a file of the run."""

    @while_running
    def strike(box: Sandbox, chance: random.Random) -> None:
        path = box.out / name
        with contextlib.suppress(OSError):
            path.unlink()
            match chance.randrange(3):
                case 0:
                    path.write_bytes(b"somebody else's")
                case 1:
                    path.symlink_to(box.home / "stderr")
                case _:
                    path.mkdir()

    return strike


@while_running
def damage(box: Sandbox, chance: random.Random) -> None:
    """Overwrite some bytes of the recording that have been written."""
    with contextlib.suppress(OSError), (box.out / "run.mcap").open("r+b") as file:
        file.seek(chance.randrange(15_000))
        file.write(chance.randbytes(chance.choice((1, 8, 100))))


def occupy_result(box: Sandbox, _chance: random.Random) -> None:
    """Make a folder where the run wants to write its result."""
    box.notes["blocked"] = True
    (box.out / "result.json").mkdir(parents=True)


def few_files(_box: Sandbox, chance: random.Random) -> Callable[[], None]:
    """Limit each process to few open files (ulimit -n)."""
    number = chance.choice((chance.randrange(5, 16), chance.randrange(16, 80)))
    return limit(resource.RLIMIT_NOFILE, number)


def small_files(_box: Sandbox, chance: random.Random) -> Callable[[], None]:
    """Limit each process to small files (ulimit -f)."""
    return limit(resource.RLIMIT_FSIZE, 1024 * chance.randrange(1, 2000))


def little_memory(_box: Sandbox, chance: random.Random) -> Callable[[], None]:
    """Give each process little address space (ulimit -v)."""
    return limit(resource.RLIMIT_AS, chance.randrange(60, 2000) << 20)


def little_time(_box: Sandbox, chance: random.Random) -> Callable[[], None]:
    """Give each process little processor time (ulimit -t)."""
    return limit(resource.RLIMIT_CPU, chance.randrange(1, 4))


def limit(what: int, number: int) -> Callable[[], None]:
    """Return what sets a limit of the process that calls it."""
    return lambda: resource.setrlimit(what, (number, number))
