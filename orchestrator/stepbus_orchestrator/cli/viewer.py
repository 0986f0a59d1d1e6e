"""The view of a live run: a process of its own, which the run does not wait for."""

import contextlib
import select
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from stepbus_orchestrator.cli.terminal.output import print_error
from stepbus_schemas import WiringError

_START_S = 30.0
"""A view takes two seconds to load, on a busy machine ten times that."""
_END_S = 5.0
_POLL_S = 0.1
_COMMAND = [sys.executable, "-P", "-m", "stepbus_orchestrator.cli", "view"]


@contextlib.contextmanager
def viewed(folder: Path, *, opens: bool, stays: bool, interrupt: threading.Event) -> Iterator[None]:
    """Show a run in a browser while this is open.

    folder: of the run, which may not be there yet. opens: whether the view opens a browser. stays:
    after the run, it shows the recording until the user ends this process, which sets `interrupt`.
    Raises WiringError when the view, which has printed why, cannot start; the run does not wait for
    one that does nothing.
    """
    options = [*([] if stays else ["--until-end"]), *([] if opens else ["--no-open"])]
    viewer = subprocess.Popen(
        [*_COMMAND, str(folder), "--follow", *options],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        encoding="utf-8",
    )
    try:
        _announce(viewer, interrupt)
        yield
        if stays:
            print_error("the view stays open until Ctrl-C")
            while not interrupt.wait(_POLL_S) and viewer.poll() is None:
                pass
    finally:
        viewer.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            viewer.wait(_END_S)
        viewer.kill()
        viewer.wait()  # no time-out: it has ended, or was killed
        if viewer.stdout is not None:
            viewer.stdout.close()


def _announce(viewer: subprocess.Popen[str], interrupt: threading.Event) -> None:
    """Print where a view is, as soon as it says so; one that takes very long is left to itself.

    Raises WiringError for one that cannot start, KeyboardInterrupt where the user ends this.
    """
    give_up = time.monotonic() + _START_S
    if (stdout := viewer.stdout) is None:
        return
    while not select.select([stdout], [], [], _POLL_S)[0]:
        if interrupt.is_set():
            raise KeyboardInterrupt
        if time.monotonic() > give_up:
            print_error(
                f"the view (pid {viewer.pid}) has not started after "
                f"{_START_S:.0f} s; is its process stopped? The run starts without it"
            )
            return
    if not (place := stdout.readline().strip()):
        raise WiringError("the view cannot start, so the run does not either")
    print_error(place)
