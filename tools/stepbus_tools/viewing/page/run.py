"""What a page shows of one run."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.analysis.signals import tracking_pieces
from stepbus_orchestrator.recording import Recording, layout
from stepbus_orchestrator.run.result import RESULT_FILE, Result
from stepbus_participant import read_file
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import UNDECODABLE, StepbusError
from stepbus_tools.report.curves import TrackingCurves
from stepbus_tools.viewing.exports import check_readable
from stepbus_tools.viewing.page.joint_curves import Arrays, joint_groups
from stepbus_tools.viewing.page.timeline import Happening, StepTimes, happenings, step_times
from stepbus_tools.viewing.render import Pixels
from stepbus_tools.viewing.scene_file import scene_still

from .ports import BasePath, Stills, Taker, takers


@dataclass(frozen=True, kw_only=True)
class RunPage:
    """One run. lines: of the summary. groups: of charts. left_out: happenings that are not shown.

    problems: what cannot be shown, a sentence each.
    """

    name: str
    path: Path
    result: Result | None
    lines: Sequence[str]
    groups: Sequence[Mapping[str, Any]]
    happenings: Sequence[Happening]
    left_out: int
    times: Mapping[str, StepTimes]
    end_s: float
    last_step: int
    stills: Sequence[Stills] = ()
    paths: Sequence[BasePath] = ()
    problems: Sequence[str] = field(default_factory=list)
    still: Pixels | None = None


def read_run(path: Path, arrays: Arrays, lines: Sequence[str] = ()) -> RunPage:
    """Read what a page shows of a recording, piece by piece.

    Raises RecordingFailed when it is no recording, or has no messages of types that it knows.
    """
    with Recording(path) as recording:
        check_readable(recording)
        result = _result(recording.path.parent, recording.path)
        groups, problems, end_s = _joints(recording, arrays)
        readers, others = takers(recording)
        problems += others
        end_s = max(end_s, _take(recording, readers))
        for taker in readers:
            if not isinstance(taker, Stills | BasePath):
                group = taker.group(arrays)
                if group["charts"]:
                    groups.append(group)
            if taker.problem:
                problems.append(f"{taker.port.topic}: {taker.problem}")
        happened, left_out = happenings(recording, result)
        if recording.cut_short:
            end = f"it is shown up to step {recording.last_step}"
            problems.insert(0, f"the recording {recording.cut_short}; {end}")
        return RunPage(
            name=_name(recording, result),
            path=recording.path,
            result=result,
            lines=lines,
            groups=groups,
            happenings=happened,
            left_out=left_out,
            times=step_times(recording.path.parent) if result else {},
            end_s=end_s,
            last_step=recording.last_step,
            stills=[taker for taker in readers if isinstance(taker, Stills)],
            paths=[taker for taker in readers if isinstance(taker, BasePath)],
            problems=problems,
            still=_still(recording),
        )


def _still(recording: Recording) -> Pixels | None:
    """Return the scene at the end of a recording; None where there is none to show."""
    try:
        return scene_still(recording)
    except (StepbusError, OSError, ValueError):
        return None


def _joints(
    recording: Recording, arrays: Arrays
) -> tuple[list[Mapping[str, Any]], list[str], float]:
    """Return the charts of joints, why there are none, and the last time [s]."""
    end_s = 0.0
    curves = TrackingCurves()
    try:
        for piece in tracking_pieces(recording):
            curves.take(piece)
            end_s = max([end_s, *(float(one.t[-1]) for one in piece.states.values())])
        return list(joint_groups(curves, arrays)), [], end_s
    except StepbusError as exc:
        return [], [f"joints: {exc}"], end_s


def _take(recording: Recording, readers: Sequence[Taker]) -> float:
    """Give all pieces to those who take them; return the last time [s]."""
    end_s = 0.0
    for piece in recording.batches({taker.port: None for taker in readers}):
        for taker in readers:
            batch = piece[taker.port.topic]
            if not len(batch.steps) or taker.problem:
                continue
            end_s = max(end_s, float(batch.t[-1]))
            try:
                taker.take(batch)
            except StepbusError as exc:
                taker.problem = str(exc)
    return end_s


def _result(folder: Path, recording: Path) -> Result | None:
    """Return the result of a run beside its recording; None where there is none of this one."""
    if recording.name != layout.RUN_FILE:
        return None
    try:
        return msgspec.json.decode(read_file(folder / RESULT_FILE), type=Result)
    except (OSError, *UNDECODABLE):
        return None


def _name(recording: Recording, result: Result | None) -> str:
    if result is not None:
        return result.scenario
    text = recording.attachments.get(layout.SCENARIO_ATTACHMENT, b"").decode(errors="replace")
    with contextlib.suppress(StepbusError):
        content = parse_yaml(layout.SCENARIO_ATTACHMENT, text)
        if isinstance(content, dict) and content.get("name"):
            return str(content["name"])
    return recording.path.stem
