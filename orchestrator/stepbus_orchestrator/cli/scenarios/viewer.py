"""The page beside a run: a process of its own, which the run does not wait for."""

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from stepbus_orchestrator.cli.terminal.output import print_error
from stepbus_schemas import WiringError

_END_S = 5.0
_COMMAND = [sys.executable, "-P", "-m", "stepbus_orchestrator.cli", "view"]


@contextlib.contextmanager
def viewed(folder: Path, *, stays: bool, opens: bool) -> Iterator[None]:
    """Show a run in the browser while this is open.

    folder: of the run, which may not be there yet. stays: after the run, the page shows its
    recording until the user ends this process. Raises WiringError when there is no page.
    """
    options = [*([] if stays else ["--until-end"]), *([] if opens else ["--no-open"])]
    command = [*_COMMAND, str(folder), "--follow", *options]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE) as viewer:
        try:
            _announce(viewer)
            yield
            if stays:
                print_error("the view stays open until Ctrl-C")
                viewer.wait()
        except KeyboardInterrupt:
            pass
        finally:
            _end(viewer)


def _announce(viewer: subprocess.Popen[bytes]) -> None:
    line = viewer.stdout.readline().decode() if viewer.stdout is not None else ""
    if not line:
        raise WiringError("the view could not be started; `stepbus run` without --view works")
    print_error(line.strip())


def _end(viewer: subprocess.Popen[bytes]) -> None:
    """End the page's process, whatever it does."""
    viewer.terminate()
    try:
        viewer.wait(_END_S)
    except subprocess.TimeoutExpired:
        viewer.kill()
