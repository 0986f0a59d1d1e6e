"""Full disks, files that another process removes, cuts or replaces, and limits of `ulimit`."""

from __future__ import annotations

import contextlib
import os
import random
import resource
import shutil
import signal
from collections.abc import Callable

from .sandbox import START_S, Missed, Sandbox, Strike

Prepare = Callable[[Sandbox, random.Random], Callable[[], None] | None]
"""Prepares a sandbox; returns what the process of the run does first, None: nothing."""

_LIMIT_BYTES = 1 << 20
_MCAP_END = b"\x89MCAP0\r\n"


def while_running(strike: Strike) -> Strike:
    """Return the strike at an orchestrator that is stopped meanwhile, so that no run ends before.

    One that has written its recording whole has been missed.
    """

    def at_rest(box: Sandbox, chance: random.Random) -> None:
        box.orchestrator.send_signal(signal.SIGSTOP)
        with contextlib.suppress(ChildProcessError):
            os.waitid(os.P_PID, box.orchestrator.pid, os.WSTOPPED | os.WEXITED | os.WNOWAIT)
        try:
            if _is_written(box):
                raise Missed
            # One that has ended meanwhile may have removed what is struck.
            with contextlib.suppress(OSError):
                strike(box, chance)
        finally:
            box.orchestrator.send_signal(signal.SIGCONT)

    return at_rest


def _is_written(box: Sandbox) -> bool:
    with contextlib.suppress(OSError):
        data = (box.out / "run.mcap").read_bytes()
        return data.endswith(_MCAP_END) and len(data) > len(_MCAP_END)
    return False


def small_disk(options: str, low: int = 0, high: int = 1) -> Prepare:
    """Return what puts the run's folder on a small file system, or limits the size of its files.

    options: of `mount`, with a number from `low` to below `high`.
    """

    def prepare(box: Sandbox, chance: random.Random) -> Callable[[], None] | None:
        if box.mount("disk", options.format(chance.randrange(low, high))):
            return None
        return _limit(resource.RLIMIT_FSIZE, _LIMIT_BYTES)

    return prepare


def small_temporary_disk(box: Sandbox, chance: random.Random) -> None:
    """Leave hardly any room for temporary files."""
    box.mount("tmp", f"size={4 * chance.randrange(1, 12)}k")


@while_running
def fill(box: Sandbox, _chance: random.Random) -> None:
    """Take the space of the run's folder away while it runs."""
    with (box.home / "disk" / "ballast").open("wb") as file:
        while True:
            file.write(bytes(4096))
            file.flush()


@while_running
def move_folder(box: Sandbox, _chance: random.Random) -> None:
    """Move the run's folder away."""
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
    size = (box.out / "run.mcap").stat().st_size
    os.truncate(box.out / "run.mcap", chance.randrange(size + 1))


def replace(name: str) -> Strike:
    """Return a strike that puts something else into the place of a file of the run."""

    @while_running
    def strike(box: Sandbox, chance: random.Random) -> None:
        path = box.out / name
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
    with (box.out / "run.mcap").open("r+b") as file:
        file.seek(chance.randrange(15_000))
        file.write(chance.randbytes(chance.choice((1, 8, 100))))


def occupy_result(box: Sandbox, _chance: random.Random) -> None:
    """Make a folder where the run wants to write its result."""
    box.notes["blocked"] = True
    (box.out / "result.json").mkdir(parents=True)


def limit(what: int, low: int, high: int, unit: int = 1) -> Prepare:
    """Return what gives each process a limit of `ulimit`, from `low` to below `high` units."""
    return lambda _box, chance: _limit(what, unit * chance.randrange(low, high))


def _limit(what: int, number: int) -> Callable[[], None]:
    """Return what sets a limit of the process that calls it."""
    return lambda: resource.setrlimit(what, (number, number))
