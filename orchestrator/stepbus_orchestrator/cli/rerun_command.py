"""`stepbus rerun`: run again from nothing but a recording."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..errors import ExitCode
from ..rerun import Preparation, Rerun
from .command import Command
from .divergence import compare, divergence
from .interrupt import interruptible
from .live import make_display
from .output import complain, say, say_json


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, help="the run.mcap of a run")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="PATH=VALUE",
        help="override one value, e.g. window=1; may be repeated",
    )
    parser.add_argument("--out", type=Path, help="folder of the new run (default: in runs/)")
    parser.add_argument("--json", action="store_true", help="print the result as JSON only")


def _execute(args: argparse.Namespace) -> int:
    preparation = Preparation(args.recording, args.out or _default(args.recording), args.set)
    if not args.json:
        _warn(preparation.notes)
    rerun = _run(preparation, quiet=args.json)
    if args.json:
        return _answer(rerun)
    _warn(rerun.notes[len(preparation.notes) :])
    return _conclude(rerun)


def _default(recording: Path) -> Path:
    """Return a new folder in runs/, named after the recorded run and numbered."""
    path = recording.absolute()
    stem = f"{path.parent.name if path.name == 'run.mcap' else path.stem}-rerun"
    names = [stem, *(f"{stem}-{number}" for number in range(2, 1000))]
    return next(Path("runs") / name for name in names if not (Path("runs") / name).exists())


def _warn(notes: list[str]) -> None:
    for note in notes:
        say(f"note: {note}")


def _run(preparation: Preparation, *, quiet: bool) -> Rerun:
    display = None if quiet else make_display(preparation.scenario.name)
    try:
        with interruptible() as interrupt:
            return preparation.run(display, interrupt)
    finally:
        if display is not None:
            display.close()
