"""The views beside a run: processes of their own, which the run does not wait for."""

import contextlib
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from stepbus_orchestrator.cli.output import print_error
from stepbus_schemas import WiringError

_START_S = 30.0
"""A view takes two seconds to load, on a busy machine ten times that."""
_END_S = 5.0
_POLL_S = 0.1
_COMMAND = [sys.executable, "-P", "-m", "stepbus_orchestrator.cli", "view"]
_PREFIX, _INTERRUPTED = "stepbus: ", "interrupted"


@contextlib.contextmanager
def viewed(
    folder: Path, views: Sequence[Sequence[str]], *, stays: bool, interrupt: threading.Event
) -> Iterator[None]:
    """Show a run while this is open.

    folder: of the run, which may not be there yet. views: the options of `stepbus view` for each.
    stays: after the run, they show its recording until the user ends this process, which sets
    `interrupt`. Raises WiringError when one cannot start; the run does not wait for one that does
    nothing.
    """
    more = [str(folder), "--follow", *([] if stays else ["--until-end"])]
    viewers: list[_Viewer] = []
    try:
        # At once: each takes a second to load.
        viewers.extend(_Viewer([*_COMMAND, *more, *options]) for options in views)
        _announce(viewers, interrupt)
        yield
        if stays and views:
            print_error("the view stays open until Ctrl-C")
            while not interrupt.wait(_POLL_S) and any(v.process.poll() is None for v in viewers):
                pass
    finally:
        _end(viewers)


class _Viewer:
    """The process of one view. has_begun: it has said where it is, or why it has ended."""

    def __init__(self, command: Sequence[str]) -> None:
        self.process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        self.has_begun = threading.Event()
        self.place = ""
        self.why_not = ""
        # Whoever reads a process that is stopped, or slow, waits: the run must not.
        self._listener = threading.Thread(target=self._listen, name="viewer", daemon=True)
        self._listener.start()

    def _listen(self) -> None:
        stdout, stderr = self.process.stdout, self.process.stderr
        if stdout is None or stderr is None:
            return
        with stdout, stderr:
            self.place = stdout.readline().decode().strip()
            if not self.place:
                words = stderr.read().decode(errors="replace")
                why = words.strip().rpartition("\n")[2].removeprefix(_PREFIX)
                self.why_not = why or "the view could not be started"
            self.has_begun.set()
            _pass_on(self.process)

    def end(self) -> None:
        """Wait until its process, which was told to, has ended; kill it where it does not."""
        try:
            self.process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()  # no time-out: it was killed
        self._listener.join(_END_S)


def _pass_on(viewer: subprocess.Popen[bytes]) -> None:
    for line in viewer.stderr or ():
        text = line.decode(errors="replace").rstrip().removeprefix(_PREFIX)
        # That it is ended with the run is no news.
        if text != _INTERRUPTED:
            print_error(text)


def _announce(viewers: Sequence[_Viewer], interrupt: threading.Event) -> None:
    """Print where the views are, as soon as all have begun.

    One that takes very long is left to itself. Raises WiringError for one that cannot start,
    KeyboardInterrupt where the user ends this.
    """
    give_up = time.monotonic() + _START_S
    for viewer in viewers:
        while not viewer.has_begun.wait(_POLL_S):
            if interrupt.is_set():
                raise KeyboardInterrupt
            if time.monotonic() > give_up:
                pid = viewer.process.pid
                print_error(
                    f"the view (pid {pid}) has not begun after {_START_S:.0f} s; is its process "
                    "stopped? The run begins without it"
                )
                break
        else:
            if viewer.why_not:
                if interrupt.is_set():
                    raise KeyboardInterrupt
                raise WiringError(viewer.why_not)
            print_error(viewer.place)


def _end(viewers: Sequence[_Viewer]) -> None:
    """End the processes, whatever they do."""
    for viewer in viewers:
        viewer.process.terminate()
    for viewer in viewers:
        viewer.end()
