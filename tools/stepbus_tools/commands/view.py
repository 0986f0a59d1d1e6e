"""`stepbus view`: a recording, or a live run, in the browser."""

import os
import threading
from contextlib import closing
from pathlib import Path

from stepbus_orchestrator.cli.interrupts import interruptible
from stepbus_orchestrator.cli.terminal.output import print_error, say
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.live_file import LIVE_FILE
from stepbus_tools.commands.declared import View
from stepbus_tools.report.summary import scenario_name
from stepbus_tools.viewing.door import open_in_browser, open_page
from stepbus_tools.viewing.live_page import follow
from stepbus_tools.viewing.playback import Playback, open_recording, play

_NICE = 15


def view_command(given: View) -> int:
    """Show a recording or a live run until the user ends it."""
    path, ghost = given.recording, given.ghost
    is_live = ghost is None and (given.follow or (path / LIVE_FILE).exists())
    recordings = [] if is_live else [_opened(path), *([_opened(ghost)] if ghost else [])]
    folder = path.parent if path.is_file() else path
    label = " · ".join(dict.fromkeys(map(scenario_name, recordings))) or folder.name
    parent = os.getppid()
    with (
        interruptible() as interrupt,
        closing(open_page(label, host=given.host, port=given.port or 0)) as page,
    ):
        say(f"view: {page.address}\nCtrl-C closes it")
        if not given.no_open:
            threading.Thread(target=open_in_browser, args=(page.address,), daemon=True).start()
        if is_live:
            # The run, which has waited for it so far, comes first.
            os.nice(_NICE)
            has_ended = follow(
                page.server, folder, lambda: interrupt.is_set() or os.getppid() != parent
            )
            if given.until_end or not has_ended:
                return 0
            recordings = [_opened(folder)]
            page.server.scene.reset()
            page.server.gui.reset()
        play(Playback(page.server, *recordings), interrupt.is_set)
    return 0


def _opened(path: Path) -> Recording:
    recording = open_recording(path)
    if recording.cut_short:
        end = f"it is shown up to step {recording.last_step}"
        print_error(f"{recording.path} {recording.cut_short}; {end}")
    return recording
