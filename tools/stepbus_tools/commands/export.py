"""`stepbus export`: a recording for other programs."""

import argparse
from pathlib import Path

from stepbus_orchestrator.cli import Command, add_recording, print_error, say
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import WiringError
from stepbus_tools.viewing.exports import FORMS, Exported, damage_line, export, progress_bar


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_recording(parser)
    parser.add_argument(
        "--parquet",
        type=Path,
        metavar="PATH",
        help="tables: a folder gets a file for each port, a .parquet file a row for each value",
    )
    parser.add_argument("--csv", type=Path, metavar="PATH", help="the same as CSV")
    parser.add_argument(
        "--scene",
        type=Path,
        metavar="FILE",
        help="robot and world in motion, with a time slider: one HTML file that opens offline",
    )
    parser.add_argument(
        "--ros2",
        type=Path,
        metavar="FILE",
        help="an .mcap that ros2 bag and rosbags read: joints, frames, odometry, images",
    )
    parser.add_argument(
        "--foxglove",
        type=Path,
        metavar="FILE",
        help="an .mcap for Foxglove and Lichtblick, at 30 Hz, and a layout beside it",
    )
    parser.add_argument(
        "--video",
        type=Path,
        metavar="FILE",
        help=".mp4 or .gif of the recorded camera, or of the scene where there is none",
    )
    parser.add_argument(
        "--camera",
        default="",
        metavar="PORT",
        help="with --video: a port of images; default: the first",
    )
    parser.add_argument(
        "--viewpoint",
        default="",
        metavar="FROM",
        help="with --video: draw the scene from corner, front, left, right, above, or from "
        "X,Y,Z[:X,Y,Z] [m]: the eye, and what it looks at",
    )


def _execute(args: argparse.Namespace) -> int:
    given = {form: getattr(args, form) for form in FORMS}
    targets = {form: path for form, path in given.items() if path is not None}
    if not targets:
        raise WiringError("nothing to export; name a target, e.g. --parquet tables")
    options = {"camera": args.camera, "viewpoint": args.viewpoint, "progress": progress_bar}
    is_whole = True
    with Recording(args.recording) as recording:
        for form, done in export(recording, targets, **options):
            for line in done.problems:
                print_error(line)
            say(f"wrote {_listed(targets[form], done)}")
            is_whole = is_whole and not done.lost
        if damage := damage_line(recording):
            print_error(damage)
    return ExitCode.FINISHED if is_whole else ExitCode.RECORDING


def _listed(target: Path, done: Exported) -> str:
    size = sum(path.stat().st_size for path in done.paths) / 1e6
    files = f", {len(done.paths)} files" if len(done.paths) > 1 else ""
    return f"{target} ({size:.1f} MB{files})"


COMMAND = Command(
    name="export",
    summary="write a recording for other programs",
    description="Writes a recording as tables for pandas, polars and DuckDB, "
    "or its scene as one HTML file. A damaged recording "
    "is exported up to its damage. Exit code 8: a port could not be exported to its end.",
    examples=(
        "stepbus export run.mcap --parquet tables",
        "stepbus export runs/arm --csv all.csv",
        "stepbus export runs/arm --video arm.mp4 --viewpoint front",
        "stepbus export runs/arm --ros2 arm.mcap",
        "stepbus export run.mcap --scene scene.html",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
)
