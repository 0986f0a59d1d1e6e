"""What the summary of a run says of its recording, in lines."""

import csv
import math
import os
from collections.abc import Mapping
from pathlib import Path

from stepbus_orchestrator.recording import Recording, Tail
from stepbus_orchestrator.run.result import result_beside
from stepbus_participant import open_regular
from stepbus_tools.report.curves import JointCurves
from stepbus_tools.report.findings import findings
from stepbus_tools.signals import TrackingError, tracking_pieces
from stepbus_tools.theme import engineering

NO_DYNAMICS = "joints and base follow their commands instantly"
_PARTS = ("compute", "transport", "record", "wait")
_SETTLED_S = 2.0
# More joints than that are named by the worst one only.
_MOST_NAMED = 6


def read_joints(recording: Recording) -> tuple[JointCurves, list[str]]:
    """Return the curves of a recording's joints, and what a summary says of it.

    It is read piece by piece. Raises MessageError where that of a joint cannot be read.
    """
    ends = [row.t_ns * 1e-9 for port in recording.of_type("JointState/1") if (row := port.last)]
    after_s = _SETTLED_S if max(ends, default=0.0) > _SETTLED_S else 0.0
    curves, tracked = JointCurves(), TrackingError(after_s)
    for piece in tracking_pieces(recording):
        curves.take(piece)
        tracked.take(piece)
    units = {joint: curves.unit(joint) for joint in curves.joints}
    result = result_beside(recording)
    late = result.real_time.complaint() if result and result.real_time else ""
    lines = [
        *tracking_lines(tracked.rmse(), units, after_s),
        *(f"attention {line}" for line in [*findings(recording), late] if line),
        *_profile_lines(recording.path.parent / "profile"),
    ]
    if lacks_dynamics(recording):
        lines.append(f"dynamics  off: {NO_DYNAMICS}")
    return curves, lines


def lacks_dynamics(recording: Recording) -> bool:
    """Return whether a plant of the recording moved without dynamics."""
    return any("dynamics" in port.description.details for port in recording.ports.values())


def scenario_name(recording: Recording | Tail) -> str:
    """Return what the recorded scenario is called, or the file where it has none."""
    return str(recording.scenario.get("name") or recording.path.stem)


def _profile_lines(folder: Path) -> list[str]:
    """Return the mean step of each participant, the busiest first, and that this limits the run.

    It waits least: the others wait for it. folder: of the files of `--profile`.
    """
    rows = []
    for path in sorted(folder.glob("*.csv")):
        if means := _mean_step_us(path):
            busy = 1 - means["wait"] / (sum(means.values()) or 1.0)
            rows.append((busy, path.stem, means))
    rows.sort(key=lambda row: -row[0])
    lines = [
        f"profile   {name}: {', '.join(f'{p} {means[p]:.0f} µs' for p in _PARTS)} a step"
        for _, name, means in rows
    ]
    for busy, name, means in rows[:1]:
        longest = max(_PARTS[:-1], key=lambda part: means[part])
        lines.append(
            f"limit     {name} is the bottleneck: it is busy {100 * busy:.0f} % of the "
            f"time, longest with: {longest}"
        )
    return lines


def _mean_step_us(path: Path) -> dict[str, float]:
    """Return how long each part of a step takes [µs]; nothing without a step.

    On a disk that was full, the last row is cut off.
    """
    totals, steps = dict.fromkeys(_PARTS, 0), 0
    with os.fdopen(open_regular(path), newline="") as file:
        for row in csv.DictReader(line for line in file if line.endswith("\n")):
            steps += 1
            for part in _PARTS:
                totals[part] += int(row[f"{part}_ns"])
    return {part: total * 1e-3 / steps for part, total in totals.items()} if steps else {}


def tracking_lines(
    rmse: Mapping[str, float], units: Mapping[str, str], after_s: float
) -> list[str]:
    """Return the tracking in lines, none without a reference; rmse, units: by joint.

    Of many joints, the worst of each unit is named. after_s: the start of what is summed up [s].
    """
    if not rmse:
        return []
    when = f"after {after_s:g} s" if after_s else "of the whole run"
    if len(rmse) > _MOST_NAMED:
        by_unit = {
            units[joint]: joint
            for joint in sorted(rmse, key=lambda j: (math.isnan(rmse[j]), rmse[j]))
        }
        worst = (by_unit[unit] for unit in ("rad", "m") if unit in by_unit)
        texts = [f"{engineering(rmse[joint], units[joint])} ({joint})" for joint in worst]
        return [f"tracking RMSE {when}: at most {', '.join(texts)}"]
    texts = [f"{joint} {engineering(rmse[joint], units[joint])}" for joint in rmse]
    return [f"tracking RMSE {when}: {', '.join(texts)}"]
