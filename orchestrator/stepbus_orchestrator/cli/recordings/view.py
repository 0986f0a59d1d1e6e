"""`stepbus view`: a recording, or a run that is going, in the browser."""

import argparse
import os
import threading
import webbrowser
from pathlib import Path
from typing import Any

from stepbus_orchestrator.cli.command import Command, number
from stepbus_orchestrator.cli.terminal.interrupt import interruptible
from stepbus_orchestrator.cli.terminal.output import print_error, say
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.control.live_file import LIVE_FILE

_NICE = 15
_LOOPBACK = "127.0.0.1"


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "recording",
        type=Path,
        help="the run.mcap of a run, or its folder; also of a run that is going",
    )
    parser.add_argument(
        "ghost", type=Path, nargs="?", help="a second recording, drawn as a ghost beside it"
    )
    parser.add_argument(
        "--port", type=number("a port", 0), default=0, help="where to listen (default: any free)"
    )
    parser.add_argument(
        "--host", default=_LOOPBACK, help="address to listen on (default: this machine only)"
    )
    parser.add_argument(
        "--follow", action="store_true", help="wait for a run to start in this folder"
    )
    parser.add_argument(
        "--until-end",
        action="store_true",
        help="end with the run, instead of showing its recording",
    )
    parser.add_argument("--no-open", action="store_true", help="start no browser")


def _execute(args: argparse.Namespace) -> int:
    if args.ghost is None and (args.follow or (args.recording / LIVE_FILE).exists()):
        return _follow(args)
    # They load viser, of an extra.
    from stepbus_orchestrator.viewing.playback import open_recording  # noqa: PLC0415
    from stepbus_orchestrator.viewing.stage import open_page  # noqa: PLC0415

    recording = open_recording(args.recording)
    other = None if args.ghost is None else open_recording(args.ghost)
    if recording.damage:
        print_error(f"{recording.path} is damaged: {recording.damage}; what precedes it is shown")
    page = open_page(recording.path.parent.name, host=args.host, port=args.port)
    try:
        with interruptible() as interrupt:
            _announce(page.address, opens=not args.no_open)
            _play(page.server, recording, other, interrupt)
    finally:
        page.close()
    return 0


def _play(
    server: Any, recording: Recording, other: Recording | None, interrupt: threading.Event
) -> None:
    from stepbus_orchestrator.viewing.playback import Playback, play  # noqa: PLC0415

    play(Playback(server, recording, other), interrupt.is_set)


def _follow(args: argparse.Namespace) -> int:
    """Show a run that is going, and its recording when it has ended."""
    from stepbus_orchestrator.viewing.live import follow  # noqa: PLC0415
    from stepbus_orchestrator.viewing.playback import open_recording  # noqa: PLC0415
    from stepbus_orchestrator.viewing.stage import open_page  # noqa: PLC0415

    # A run comes first.
    os.nice(_NICE)
    folder = args.recording.parent if args.recording.is_file() else args.recording
    page = open_page(folder.name, host=args.host, port=args.port)
    try:
        with interruptible() as interrupt:
            _announce(page.address, opens=not args.no_open)
            parent = os.getppid()
            has_ended = follow(
                page.server, folder, lambda: interrupt.is_set() or os.getppid() != parent
            )
            if has_ended and not args.until_end:
                page.server.scene.reset()
                page.server.gui.reset()
                _play(page.server, open_recording(folder), None, interrupt)
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
