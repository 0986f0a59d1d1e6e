"""`stepbus view`: a recording, or a live run, in the browser or in Foxglove."""

import os
import threading
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

from stepbus_orchestrator.cli.signals import interruptible
from stepbus_orchestrator.cli.terminal.output import print_error, say
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.live_file import LIVE_FILE
from stepbus_schemas import WiringError
from stepbus_tools.commands.declared import View
from stepbus_tools.viewing.access import open_in_browser

_NICE = 15
IsOver = Callable[[], bool]


def view_command(given: View) -> int:
    """Show a recording or a live run until the user ends it."""
    recording, ghost = given.recording, given.ghost
    if given.foxglove is not None and ghost is not None:
        raise WiringError("--foxglove shows a single recording; omit it to compare two recordings")
    is_live = ghost is None and (given.follow or (recording / LIVE_FILE).exists())
    paths = () if is_live else (recording, ghost)
    opened = [_opened(path) for path in paths if path is not None]
    folder = recording.parent if recording.is_file() else recording
    label = _label(opened) or folder.name
    parent = os.getppid()
    with (
        interruptible() as interrupt,
        closing((_Page if given.foxglove is None else _Foxglove)(label, given)) as view,
    ):
        if is_live:
            # The run, which has waited for it so far, comes first.
            os.nice(_NICE)
            has_ended = view.follow(folder, lambda: interrupt.is_set() or os.getppid() != parent)
            if given.until_end or not has_ended:
                return 0
        view.play(opened or [_opened(folder)], interrupt.is_set, from_end=is_live)
    return 0


def _label(recordings: Sequence[Recording]) -> str:
    """Return what recordings are of: the names of their scenarios."""
    from stepbus_tools.report.summary import scenario_name  # noqa: PLC0415

    return " · ".join(dict.fromkeys(map(scenario_name, recordings)))


def _opened(path: Path) -> Recording:
    # What loads NumPy, and viser of an extra, is imported when it is used.
    from stepbus_tools.viewing.playback import open_recording  # noqa: PLC0415

    recording = open_recording(path)
    if recording.cut_short:
        end = f"it is shown up to step {recording.last_step}"
        print_error(f"{recording.path} {recording.cut_short}; {end}")
    return recording


class _Page:
    """A page in the browser."""

    def __init__(self, label: str, given: View) -> None:
        from stepbus_tools.viewing.stage.server import open_page  # noqa: PLC0415

        self._page = open_page(label, host=given.host, port=given.port or 0, tell=self._tell)
        say(f"view: {self._page.address}\nCtrl-C closes it")
        if not given.no_open:
            threading.Thread(target=self._browse, daemon=True).start()

    def _browse(self) -> None:
        open_in_browser(self._page.new_address())

    def _tell(self, address: str) -> None:
        print_error(
            "the URL of the view was opened a second time. To open it again yourself, use: "
            f"{address}"
        )

    def follow(self, folder: Path, is_over: IsOver) -> bool:
        """Show a live run; return whether it has ended."""
        from stepbus_tools.viewing.live_page import follow  # noqa: PLC0415

        return follow(self._page.server, folder, is_over)

    def play(self, recordings: Sequence[Recording], is_over: IsOver, *, from_end: bool) -> None:
        """Show a recording, with a second one as a ghost; from_end: after the live run."""
        from stepbus_tools.viewing.playback import Playback, play  # noqa: PLC0415

        if from_end:
            self._page.server.scene.reset()
            self._page.server.gui.reset()
        play(Playback(self._page.server, recordings[0], next(iter(recordings[1:]), None)), is_over)

    def close(self) -> None:
        """Close the page."""
        self._page.close()


class _Foxglove:
    """A server for Foxglove and Lichtblick."""

    def __init__(self, label: str, given: View) -> None:
        from stepbus_tools.viewing.foxglove_server import open_server  # noqa: PLC0415

        port = next(iter(given.foxglove or ()), given.port or 0)
        self._server = open_server(label, host=given.host, port=port)
        say(f"foxglove: {self._server.address}\nCtrl-C closes it")

    def follow(self, folder: Path, is_over: IsOver) -> bool:
        """Send a live run; return whether it has ended."""
        from stepbus_tools.viewing.foxglove_feed import follow  # noqa: PLC0415

        return follow(self._server, folder, is_over)

    def play(self, recordings: Sequence[Recording], is_over: IsOver, *, from_end: bool) -> None:
        """Send a recording; from_end: after the live run."""
        from stepbus_tools.viewing.foxglove_feed import play  # noqa: PLC0415

        play(self._server, recordings[0], is_over, from_end=from_end)

    def close(self) -> None:
        """Close the server."""
        self._server.close()
