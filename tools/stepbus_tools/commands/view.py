"""`stepbus view`: a recording, or a run that is going, in the browser."""

import argparse
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from stepbus_orchestrator.cli import (
    Command,
    add_foxglove,
    add_recording,
    interruptible,
    port,
    print_error,
    say,
)
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.live_file import LIVE_FILE
from stepbus_schemas import WiringError
from stepbus_tools.viewing.access import open_in_browser

_NICE = 15
_LOOPBACK = "127.0.0.1"
IsOver = Callable[[], bool]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_recording(parser, "; also of a run that is going")
    parser.add_argument(
        "ghost", type=Path, nargs="?", help="a second recording, drawn as a ghost beside it"
    )
    parser.add_argument("--port", type=port, default=0, help="where to listen (default: any free)")
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
    add_foxglove(parser, "instead of the page: ")


@dataclass(frozen=True, kw_only=True)
class _Shown:
    """A page, or a server for Foxglove. name: for its address. browse: opens a browser."""

    name: str
    address: str
    browse: Callable[[], None] | None = None
    follow: Callable[[Path, Callable[[], bool]], bool]
    play: Callable[..., None]


Show = Callable[[argparse.Namespace, str], AbstractContextManager[_Shown]]


def _execute(args: argparse.Namespace) -> int:
    if args.foxglove is not None and args.ghost is not None:
        raise WiringError("--foxglove shows one recording; without it, the second one is a ghost")
    is_live = args.ghost is None and (args.follow or (args.recording / LIVE_FILE).exists())
    show = _open_foxglove if args.foxglove is not None else _open_page
    if is_live:
        return _follow(args, show)
    # They load NumPy, and viser of an extra.
    from stepbus_tools.viewing.playback import open_recording  # noqa: PLC0415

    recording = open_recording(args.recording)
    other = None if args.ghost is None else open_recording(args.ghost)
    _warn_of_damage(recording)
    if other is not None:
        _warn_of_damage(other)
    with show(args, recording.path.parent.name) as shown, interruptible() as interrupt:
        _announce(args, shown)
        shown.play(recording, other, interrupt.is_set)
    return 0


def _warn_of_damage(recording: Recording) -> None:
    if recording.cut_short:
        end = f"it is shown up to step {recording.last_step}"
        print_error(f"{recording.path} {recording.cut_short}; {end}")


def _follow(args: argparse.Namespace, show: Show) -> int:
    """Show a run that is going, and its recording when it has ended."""
    # A run comes first.
    os.nice(_NICE)
    folder = args.recording.parent if args.recording.is_file() else args.recording
    with show(args, folder.name) as shown, interruptible() as interrupt:
        _announce(args, shown)
        parent = os.getppid()
        has_ended = shown.follow(folder, lambda: interrupt.is_set() or os.getppid() != parent)
        if has_ended and not args.until_end:
            from stepbus_tools.viewing.playback import open_recording  # noqa: PLC0415

            recording = open_recording(folder)
            _warn_of_damage(recording)
            shown.play(recording, None, interrupt.is_set, from_end=True)
    return 0


@contextmanager
def _open_page(args: argparse.Namespace, label: str) -> Iterator[_Shown]:
    from stepbus_tools.viewing.live_page import follow  # noqa: PLC0415  (as above)
    from stepbus_tools.viewing.playback import Playback, play  # noqa: PLC0415
    from stepbus_tools.viewing.stage import open_page  # noqa: PLC0415

    def show(
        recording: Recording, other: Recording | None, is_over: IsOver, *, from_end: bool = False
    ) -> None:
        if from_end:
            page.server.scene.reset()
            page.server.gui.reset()
        play(Playback(page.server, recording, other), is_over)

    def tell(address: str) -> None:
        print_error(f"somebody has opened an address of the view again. If it was you: {address}")

    page = open_page(label, host=args.host, port=args.port, tell=tell)
    try:
        yield _Shown(
            name="view",
            address=page.address,
            browse=lambda: open_in_browser(page.new_address()),
            follow=partial(follow, page.server),
            play=show,
        )
    finally:
        page.close()


@contextmanager
def _open_foxglove(args: argparse.Namespace, label: str) -> Iterator[_Shown]:
    from stepbus_tools.viewing.foxglove_feed import follow, play  # noqa: PLC0415  (as above)
    from stepbus_tools.viewing.foxglove_server import open_server  # noqa: PLC0415

    def show(
        recording: Recording, _: Recording | None, is_over: IsOver, *, from_end: bool = False
    ) -> None:
        play(server, recording, is_over, from_end=from_end)

    server = open_server(label, host=args.host, port=args.foxglove or args.port)
    try:
        yield _Shown(
            name="foxglove", address=server.address, follow=partial(follow, server), play=show
        )
    finally:
        server.close()


def _announce(args: argparse.Namespace, shown: _Shown) -> None:
    say(f"{shown.name}: {shown.address}\nCtrl-C closes it")
    if not args.no_open and shown.browse is not None:
        threading.Thread(target=shown.browse, daemon=True).start()


COMMAND = Command(
    name="view",
    summary="show a recording in 3D, in the browser",
    description="Shows robot and world of a recording on a page of this machine: targets as "
    "ghosts, contacts, planned paths, detections, camera images, curves and events, with a time "
    "slider. It reads what is looked at, so a long recording opens at once. Its address opens it "
    "once, in one browser.",
    examples=(
        "stepbus view runs/arm",
        "stepbus view runs/arm/run.mcap runs/other/run.mcap --no-open",
        "stepbus view runs/arm --foxglove 8765",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
)
