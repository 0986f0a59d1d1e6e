"""`stepbus export`: a recording for other programs."""

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path

from stepbus_orchestrator.cli.command import Command
from stepbus_orchestrator.cli.terminal.output import print_error, say
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.viewing.exports import Exported, export_tables, progress_bar
from stepbus_schemas import WiringError

Export = Callable[[Recording, Path, Callable[[int], None]], Exported]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, help="the run.mcap of a run, or its folder")
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


def _wanted(args: argparse.Namespace) -> dict[str, tuple[Path, Export]]:
    """Return what to export: option → target and what writes it."""
    rows: dict[str, tuple[Path | None, Export]] = {
        "parquet": (args.parquet, partial(_tables, "parquet")),
        "csv": (args.csv, partial(_tables, "csv")),
        "scene": (args.scene, _scene),
        "ros2": (args.ros2, _ros2),
        "foxglove": (args.foxglove, _foxglove),
        "video": (args.video, partial(_video, args.camera, args.viewpoint)),
    }
    return {name: (path, export) for name, (path, export) in rows.items() if path is not None}


def _tables(
    form: str, recording: Recording, target: Path, reached: Callable[[int], None]
) -> Exported:
    return export_tables(recording, target, form, reached)


def _scene(recording: Recording, target: Path, reached: Callable[[int], None]) -> Exported:
    # It loads viser, of another extra.
    from stepbus_orchestrator.viewing.scene_file import export_scene  # noqa: PLC0415

    return export_scene(recording, target, reached)


def _ros2(recording: Recording, target: Path, reached: Callable[[int], None]) -> Exported:
    from stepbus_orchestrator.viewing.exports.ros2 import export_ros2  # noqa: PLC0415  (as above)

    return export_ros2(recording, target, reached)


def _foxglove(recording: Recording, target: Path, reached: Callable[[int], None]) -> Exported:
    # As above.
    from stepbus_orchestrator.viewing.exports.foxglove import export_foxglove  # noqa: PLC0415

    return export_foxglove(recording, target, reached)


def _video(
    camera: str, viewpoint: str, recording: Recording, target: Path, reached: Callable[[int], None]
) -> Exported:
    # It loads what draws.
    from stepbus_orchestrator.viewing.exports.video import Film, export_video  # noqa: PLC0415

    return export_video(Film(camera=camera, viewpoint=viewpoint), recording, target, reached)


def _execute(args: argparse.Namespace) -> int:
    wanted = _wanted(args)
    if not wanted:
        raise WiringError("nothing to export; name a target, e.g. --parquet tables")
    with Recording(args.recording) as recording:
        for name, (target, export) in wanted.items():
            with progress_bar(name, recording.last_step) as reached:
                done = export(recording, target, reached)
            for line in done.problems:
                print_error(line)
            say(f"wrote {_listed(target, done)}")
        if recording.damage:
            print_error(
                f"{recording.path} is damaged: {recording.damage}; exported up to step "
                f"{recording.last_step}"
            )
    return 0


def _listed(target: Path, done: Exported) -> str:
    size = sum(path.stat().st_size for path in done.paths) / 1e6
    files = f", {len(done.paths)} files" if len(done.paths) > 1 else ""
    return f"{target} ({size:.1f} MB{files})"


COMMAND = Command(
    name="export",
    summary="write a recording for other programs",
    description="Writes a recording as tables for pandas, polars and DuckDB, "
    "or its scene as one HTML file. A damaged recording "
    "is exported up to its damage.",
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
