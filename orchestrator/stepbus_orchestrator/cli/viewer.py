"""The views beside a run: processes of their own, which the run does not wait for."""

import contextlib
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from stepbus_orchestrator.cli.terminal.output import print_error
from stepbus_participant import environment
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
        give_up = time.monotonic() + _START_S
        for viewer in viewers:
            viewer.announce(interrupt, give_up)
        yield
        if stays and views:
            print_error("the view stays open until Ctrl-C")
            while not interrupt.wait(_POLL_S) and any(v.process.poll() is None for v in viewers):
                pass
    finally:
        for viewer in viewers:
            viewer.process.terminate()
        for viewer in viewers:
            viewer.end()


class _Viewer:
    """The process of one view, which says first where it is, or why it has ended."""

    def __init__(self, command: Sequence[str]) -> None:
        self.process = subprocess.Popen(
            command,
            env=environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
        )
        self._has_begun = threading.Event()
        self._place = ""
        self._why_not = ""
        # A process that is stopped, or slow, makes its reader wait: the run must not.
        self._listener = threading.Thread(target=self._listen, name="viewer", daemon=True)
        self._listener.start()

    def _listen(self) -> None:
        stdout, stderr = self.process.stdout, self.process.stderr
        if stdout is None or stderr is None:
            return
        with stdout, stderr:
            self._place = stdout.readline().strip()
            if not self._place:
                why = stderr.read().strip().rpartition("\n")[2]
                self._why_not = why.removeprefix(_PREFIX) or "cannot start the view"
            self._has_begun.set()
            pass_on(stderr)

    def announce(self, interrupt: threading.Event, give_up: float) -> None:
        """Print where it is, as soon as it has begun; one that takes very long is left to itself.

        Raises WiringError for one that cannot start, KeyboardInterrupt where the user ends this.
        """
        while not self._has_begun.wait(_POLL_S):
            if interrupt.is_set():
                raise KeyboardInterrupt
            if time.monotonic() > give_up:
                print_error(
                    f"the view (pid {self.process.pid}) has not started after "
                    f"{_START_S:.0f} s; is its process stopped? The run starts without it"
                )
                return
        if self._why_not:
            raise WiringError(self._why_not)
        print_error(self._place)

    def end(self) -> None:
        """Wait until its process, which was told to, has ended; kill it where it does not."""
        try:
            self.process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()  # no time-out: it was killed
        self._listener.join(_END_S)


def pass_on(lines: Iterable[str]) -> None:
    """Print what a view complains of; that it is ended with the run is no news."""
    for line in lines:
        text = line.rstrip().removeprefix(_PREFIX)
        if text != _INTERRUPTED:
            print_error(text)
