"""The views beside a run: processes of their own, which the run does not wait for."""

import contextlib
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

from stepbus_orchestrator.cli.terminal.output import print_error
from stepbus_schemas import WiringError

_END_S = 5.0
_POLL_S = 0.1
_COMMAND = [sys.executable, "-P", "-m", "stepbus_orchestrator.cli", "view"]
_PREFIX, _INTERRUPTED = "stepbus: ", "interrupted"

Viewer = subprocess.Popen[bytes]


@contextlib.contextmanager
def viewed(
    folder: Path, views: Sequence[Sequence[str]], *, stays: bool, interrupt: threading.Event
) -> Iterator[None]:
    """Show a run while this is open.

    folder: of the run, which may not be there yet. views: the options of `stepbus view` for each.
    stays: after the run, they show its recording until the user ends this process, which sets
    `interrupt`. Raises WiringError when one cannot start.
    """
    more = [str(folder), "--follow", *([] if stays else ["--until-end"])]
    viewers: list[Viewer] = []
    try:
        # At once: each takes a second to load.
        viewers.extend(_start([*_COMMAND, *more, *options]) for options in views)
        for viewer in viewers:
            _announce(viewer, interrupt)
        yield
        if stays and views:
            print_error("the view stays open until Ctrl-C")
            while not interrupt.wait(_POLL_S) and any(v.poll() is None for v in viewers):
                pass
    finally:
        _end(viewers)


def _start(command: Sequence[str]) -> Viewer:
    return subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )


def _announce(viewer: Viewer, interrupt: threading.Event) -> None:
    """Print where a view is; from then on, what it complains of."""
    line = viewer.stdout.readline().decode() if viewer.stdout is not None else ""
    if not line:
        if interrupt.is_set():
            raise KeyboardInterrupt
        words = viewer.stderr.read().decode(errors="replace") if viewer.stderr is not None else ""
        why = words.strip().rpartition("\n")[2].removeprefix(_PREFIX)
        raise WiringError(why or "the view could not be started")
    print_error(line.strip())
    threading.Thread(target=_pass_on, args=(viewer,), name="viewer", daemon=True).start()


def _pass_on(viewer: Viewer) -> None:
    for line in viewer.stderr or ():
        text = line.decode(errors="replace").rstrip().removeprefix(_PREFIX)
        # That it is ended with the run is no news.
        if text != _INTERRUPTED:
            print_error(text)


def _end(viewers: Sequence[Viewer]) -> None:
    """End the processes, whatever they do."""
    for viewer in viewers:
        viewer.terminate()
    for viewer in viewers:
        # It closes the pipes.
        with viewer:
            try:
                viewer.wait(_END_S)
            except subprocess.TimeoutExpired:
                viewer.kill()
                viewer.wait()
