"""Recordings: compare, recover, export, report."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.recording import Recording, Recovery
from stepbus_orchestrator.recording import recover as recover_recording
from stepbus_orchestrator.recording.layout import Source, recording_file
from stepbus_orchestrator.replay import replay
from stepbus_orchestrator.replay.branch import branch
from stepbus_orchestrator.replay.rerun import rerun
from stepbus_schemas import WiringError

if TYPE_CHECKING:
    from stepbus_tools.dataframes import Comparison
    from stepbus_tools.viewing.exports import Exported

__all__ = [
    "branch",
    "compare",
    "diff",
    "export",
    "recover",
    "replay",
    "report",
    "rerun",
]


def compare(first: Source, second: Source) -> Comparison:
    """Compare the numbers of two runs, aligned by time, with an error for each of them.

    `diff` tests whether two recordings are equal; `compare` measures how far apart two runs are,
    e.g. with different parameters or step sizes. Values are compared at the times of the recording
    with fewer messages, with the value that the other holds at that time. Only values with the same
    unit in both are compared; NaN is infinitely far from any number. Read one error with
    `compare(a, b)["plant.joint_state.position.joint1"].rmse`, or all with `compare(a, b).frame()`.

    Raises RecordingFailed when a recording cannot be read.
    """
    from stepbus_tools import dataframes  # noqa: PLC0415  (a tool, when it is asked for)

    return dataframes.compare(recording_file(first), recording_file(second))


def recover(recording: Source, target: str | PathLike[str]) -> Recovery:
    """Write all complete records of a damaged recording to a new file.

    Raises RecordingFailed when there is nothing to recover, OutputExists when `target` exists.
    """
    return recover_recording(recording_file(recording), Path(target))


def export(
    recording: Source,
    *,
    parquet: str | PathLike[str] | None = None,
    csv: str | PathLike[str] | None = None,
    scene: str | PathLike[str] | None = None,
    ros2: str | PathLike[str] | None = None,
    foxglove: str | PathLike[str] | None = None,
    rerun: str | PathLike[str] | None = None,
    video: str | PathLike[str] | None = None,
    camera: str = "",
    viewpoint: str = "",
    size: str = "",
    fps: float | str = "",
    from_: str = "",
    to: str = "",
    **others: str | PathLike[str],
) -> dict[str, Exported]:
    """Export a recording as `stepbus export` does; return format → what was written.

    parquet, csv: a folder (one file per port), or a .parquet or .csv file (one row per value).
    scene: a self-contained HTML file. ros2: an .mcap, or a folder for a bag. foxglove: as ros2.
    rerun: an .rrd. video: .mp4 or .gif of `camera`, an image port (default: the first), or of the
    scene from `viewpoint`, such as "front" or "1,-2,1.5:0,0,0.5" [m]; with `size` ("1280x720"),
    `fps`, and the simulation times `from_` and `to`, such as "2s". others: formats that other
    packages add.

    `problems` lists what could not be exported, and any damage of the recording. Raises
    RecordingFailed when nothing can be exported or a file cannot be written, WiringError for an
    invalid target or option, ExtraMissing without the extra `export` or `rerun`.
    """
    from stepbus_tools.viewing import exports  # noqa: PLC0415  (a tool, when it is asked for)

    given = {
        "parquet": parquet, "csv": csv, "scene": scene, "ros2": ros2, "foxglove": foxglove,
        "rerun": rerun, "video": video, **others,
    }  # fmt: skip
    targets = {form: Path(path) for form, path in given.items() if path is not None}
    if not targets:
        raise WiringError("nothing to export; give a target, e.g. parquet='tables'")
    with Recording(recording_file(recording)) as opened:
        damage = [line for line in (exports.damage_line(opened),) if line]
        written = exports.export(
            opened, targets, camera=camera, viewpoint=viewpoint, size=size, fps=str(fps),
            from_=from_, to=to,
        )  # fmt: skip
        return {form: replace(done, problems=[*done.problems, *damage]) for form, done in written}


def report(*recordings: Source, out: str | PathLike[str] | None = None) -> Path:
    """Write the report of one run, or of several side by side; return its path.

    out: default: report.html next to the first recording. Raises RecordingFailed when a recording
    cannot be read or the page cannot be written, ExtraMissing without the extra `report`.
    """
    from stepbus_tools.viewing import page  # noqa: PLC0415  (a tool, when it is asked for)

    if not recordings:
        raise WiringError("nothing to report; give a recording")
    target = None if out is None else Path(out)
    return page.write_page([recording_file(source) for source in recordings], target)
