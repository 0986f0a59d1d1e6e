"""`stepbus view`: a recording, or a run that is going, in the browser."""

import argparse
import threading
import webbrowser
from pathlib import Path

from stepbus_orchestrator.cli.command import Command, number
from stepbus_orchestrator.cli.terminal.interrupt import interruptible
from stepbus_orchestrator.cli.terminal.output import print_error, say

_LOOPBACK = "127.0.0.1"


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, help="the run.mcap of a run, or its folder")
    parser.add_argument(
        "ghost", type=Path, nargs="?", help="a second recording, drawn as a ghost beside it"
    )
    parser.add_argument(
        "--port", type=number("a port", 0), default=0, help="where to listen (default: any free)"
    )
    parser.add_argument(
        "--host", default=_LOOPBACK, help="address to listen on (default: this machine only)"
    )
    parser.add_argument("--no-open", action="store_true", help="start no browser")


def _execute(args: argparse.Namespace) -> int:
    # They load viser, of an extra.
    from stepbus_orchestrator.viewing.playback import (  # noqa: PLC0415
        Playback,
        open_recording,
        play,
    )
    from stepbus_orchestrator.viewing.stage import open_page  # noqa: PLC0415

    recording = open_recording(args.recording)
    other = None if args.ghost is None else open_recording(args.ghost)
    if recording.damage:
        print_error(f"{recording.path} is damaged: {recording.damage}; what precedes it is shown")
    page = open_page(recording.path.parent.name, host=args.host, port=args.port)
    try:
        with interruptible() as interrupt:
            playback = Playback(page.server, recording, other)
            _announce(page.address, opens=not args.no_open)
            play(playback, interrupt.is_set)
    finally:
        page.close()
    return 0


def _announce(address: str, *, opens: bool) -> None:
    say(f"view: {address}\nCtrl-C closes it")
    if opens:
        threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()


COMMAND = Command(
    name="view",
    summary="show a recording in 3D, in the browser",
    description="Shows robot and world of a recording on a page of this machine: targets as "
    "ghosts, contacts, planned paths, detections, camera images, curves and events, with a time "
    "slider. It reads what is looked at, so a long recording opens at once. Nobody sees the page "
    "without its address.",
    examples=(
        "stepbus view runs/arm",
        "stepbus view runs/arm/run.mcap runs/other/run.mcap --no-open",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
)
