"""What the summary of a run says of its recording, in lines."""

import csv
import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from stepbus_orchestrator.analysis.findings import findings
from stepbus_orchestrator.analysis.signals import Tracking, TrackingError, tracking_pieces
from stepbus_orchestrator.recording import Recording, Tail
from stepbus_orchestrator.run.result import result_beside
from stepbus_participant import open_regular
from stepbus_tools.look import engineering
from stepbus_tools.report.curves import JointCurves

NO_DYNAMICS = "joints and base follow their commands instantly"
_PARTS = ("compute", "transport", "record", "wait")
_SETTLED_S = 2.0
# More joints than that are named by the worst one only.
_MOST_NAMED = 6


def read_joints(recording: Recording) -> tuple[JointCurves, list[str]]:
    """Return the curves of a recording's joints, and what a summary says of it.

    It is read piece by piece. Raises MessageError where that of a joint cannot be read.
    """
    curves, tracked = JointCurves(), Tracked()
    for piece in tracking_pieces(recording):
        curves.take(piece)
        tracked.take(piece)
    result = result_beside(recording)
    late = result.real_time.complaint() if result and result.real_time else ""
    lines = [
        *(tracked.lines() if curves.measured else ()),
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


class Tracked:
    """How well the joints follow their reference; give it all pieces of a recording."""

    def __init__(self) -> None:
        self._last_s = 0.0
        self._units: dict[str, str] = {}
        self._whole, self._settled = TrackingError(0.0), TrackingError(_SETTLED_S)

    def take(self, piece: Tracking) -> None:
        """Take the next piece of a recording."""
        ends = [float(state.t[-1]) for state in piece.states.values()]
        self._last_s = max([self._last_s, *ends])
        self._units |= {joint: piece.unit(joint) for joint in piece.joints}
        for part in (self._whole, self._settled):
            part.take(piece)

    def lines(self) -> list[str]:
        """Return the tracking in lines, none without a reference."""
        settled = self._last_s > _SETTLED_S
        rmse = (self._settled if settled else self._whole).rmse()
        if not rmse:
            return []
        when = f"after {_SETTLED_S:g} s" if settled else "of the whole run"
        if len(rmse) > _MOST_NAMED:
            return [f"tracking RMSE {when}: at most {', '.join(self._worst(rmse))}"]
        values = (f"{joint} {engineering(rmse[joint], self._units[joint])}" for joint in rmse)
        return [f"tracking RMSE {when}: {', '.join(values)}"]

    def _worst(self, rmse: Mapping[str, float]) -> Iterator[str]:
        """Yield the worst joint of each unit."""
        for unit in ("rad", "m"):
            joints = [joint for joint in rmse if self._units[joint] == unit]
            if joints:
                worst = max(joints, key=lambda joint: (math.isnan(rmse[joint]), rmse[joint]))
                yield f"{engineering(rmse[worst], unit)} ({worst})"
