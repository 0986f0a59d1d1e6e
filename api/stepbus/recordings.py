"""Recordings: replay, compare, run again, recover, export, report."""

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
    from stepbus_tools.figures import Comparison
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

    Where `diff` says whether two recordings are the same, this says how far two runs are apart,
    such as with other parameters or another step. Numbers are compared at the times of the
    recording with fewer messages, with what the other then holds; only those count that both have
    in the same unit. `compare(a, b)["plant.joint_state.position.joint1"].rmse` is one,
    `compare(a, b).frame()` are all.

    Raises RecordingFailed when one cannot be read.
    """
    from stepbus_tools import figures  # noqa: PLC0415  (a tool, when it is asked for)

    return figures.compare(recording_file(first), recording_file(second))


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
    """Write a recording for other programs, as `stepbus export`; return form → what was written.

    parquet, csv: a folder, which gets a file for each port, or a file that ends in .parquet or
    .csv, which gets a row for each value. scene: an HTML file that opens offline. ros2: an .mcap,
    or a folder, which becomes a bag. foxglove: an .mcap. rerun: an .rrd. video: .mp4 or .gif of
    `camera`, a port of images (default: the first), or of the scene from `viewpoint`, such as
    "front" or "1,-2,1.5:0,0,0.5" [m]; with `size` ("1280x720"), `fps`, and `from_` and `to`, times
    of the simulation such as "2s". others: forms that other packages add.

    What cannot be exported, and the damage of a recording, are sentences in `problems`. Raises
    RecordingFailed when nothing can be exported or a file cannot be written, WiringError for
    a target or an option that does not fit, ExtraMissing without the extra `export` or `rerun`.
    """
    from stepbus_tools.viewing import exports  # noqa: PLC0415  (a tool, when it is asked for)

    given = {
        "parquet": parquet, "csv": csv, "scene": scene, "ros2": ros2, "foxglove": foxglove,
        "rerun": rerun, "video": video, **others,
    }  # fmt: skip
    targets = {form: Path(path) for form, path in given.items() if path is not None}
    if not targets:
        raise WiringError("nothing to export; name a target, e.g. parquet='tables'")
    with Recording(recording_file(recording)) as opened:
        damage = [line for line in (exports.damage_line(opened),) if line]
        written = exports.export(
            opened, targets, camera=camera, viewpoint=viewpoint, size=size, fps=str(fps),
            from_=from_, to=to,
        )  # fmt: skip
        return {form: replace(done, problems=[*done.problems, *damage]) for form, done in written}


def report(*recordings: Source, out: str | PathLike[str] | None = None) -> Path:
    """Write the page of a run, or of several beside each other, as `stepbus report`; its path.

    out: default: report.html beside the first recording. Raises RecordingFailed when a recording
    cannot be read or the page cannot be written, ExtraMissing without the extra `report`.
    """
    from stepbus_tools.viewing import page  # noqa: PLC0415  (a tool, when it is asked for)

    if not recordings:
        raise WiringError("nothing to report; name a recording")
    target = None if out is None else Path(out)
    return page.write_page([recording_file(source) for source in recordings], target)
