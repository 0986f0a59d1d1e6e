"""What a summary says of a run beside its curves."""

import csv
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from stepbus_orchestrator.analysis.signals import Tracking, TrackingError
from stepbus_orchestrator.run.reports import Lateness
from stepbus_orchestrator.run.result import RESULT_FILE
from stepbus_participant import open_regular, read_file
from stepbus_schemas import UNDECODABLE


class _Result(msgspec.Struct):
    real_time: Lateness | None = None


def read_lateness(folder: Path) -> Lateness | None:
    """Return how late the steps of a run were; None where it was not in real time.

    folder: of the run; its result.json has it.
    """
    try:
        return msgspec.json.decode(read_file(folder / RESULT_FILE), type=_Result).real_time
    except (OSError, *UNDECODABLE):
        return None


PARTS = ("compute", "transport", "record", "wait")
_FOLDER = "profile"


@dataclass(frozen=True, kw_only=True)
class StepProfile:
    """The mean of one participant's steps; parts: `PARTS` → time a step [µs]."""

    name: str
    steps: int
    parts: dict[str, float]

    @property
    def busy(self) -> float:
        """Return the share of its time in which it does not wait, 0 to 1."""
        total = sum(self.parts.values())
        return 1 - self.parts["wait"] / total if total else 0.0


def read_profiles(folder: Path) -> list[StepProfile]:
    """Return the profiles of a run, the busiest participant first; folder: of the run."""
    profiles = (_read(path) for path in sorted((folder / _FOLDER).glob("*.csv")))
    return sorted((p for p in profiles if p.steps), key=lambda profile: -profile.busy)


def _read(path: Path) -> StepProfile:
    totals, steps = dict.fromkeys(PARTS, 0), 0
    with os.fdopen(open_regular(path), newline="") as file:
        for row in csv.DictReader(file):
            steps += 1
            for part in PARTS:
                totals[part] += int(row[f"{part}_ns"])
    means = {part: total * 1e-3 / max(1, steps) for part, total in totals.items()}
    return StepProfile(name=path.stem, steps=steps, parts=means)


def profile_lines(profiles: Sequence[StepProfile]) -> list[str]:
    """Return the lines of the summary: the mean step of each participant, and who limits the run.

    Whoever waits least limits it: the others wait for that participant.
    """
    if not profiles:
        return []
    lines = []
    for profile in profiles:
        parts = ", ".join(f"{part} {profile.parts[part]:.0f} µs" for part in PARTS)
        lines.append(f"profile   {profile.name}: {parts} a step")
    first = profiles[0]
    longest = max(PARTS[:-1], key=lambda part: first.parts[part])
    lines.append(
        f"limit     {first.name} waits least: it is busy {100 * first.busy:.0f} % of the time, "
        f"longest with: {longest}"
    )
    return lines


_SETTLED_S = 2.0
# More joints than that are named by the worst one only.
_MOST_NAMED = 6


class Summary:
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
        """Return it in lines, none without a reference."""
        settled = self._last_s > _SETTLED_S
        rmse = (self._settled if settled else self._whole).rmse()
        if not rmse:
            return []
        when = f"after {_SETTLED_S:g} s" if settled else "of the whole run"
        if len(rmse) > _MOST_NAMED:
            return [f"tracking RMSE {when}: at most {', '.join(self._worst(rmse))}"]
        units = self._units
        values = ", ".join(f"{joint} {value:.3g} {units[joint]}" for joint, value in rmse.items())
        return [f"tracking RMSE {when}: {values}"]

    def _worst(self, rmse: Mapping[str, float]) -> Iterator[str]:
        """Yield the worst joint of each unit."""
        for unit in ("rad", "m"):
            joints = [joint for joint in rmse if self._units[joint] == unit]
            if joints:
                worst = max(joints, key=lambda joint: rmse[joint])
                yield f"{rmse[worst]:.3g} {unit} ({worst})"
