"""What `stepbus run --profile` has measured: where the time of each participant's steps went."""

import csv
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stepbus_participant import open_regular

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
    found = (_read(path) for path in sorted((folder / _FOLDER).glob("*.csv")))
    return sorted((p for p in found if p.steps), key=lambda profile: -profile.busy)


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
