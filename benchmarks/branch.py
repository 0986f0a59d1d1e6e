"""Branches of all shipped scenarios at random steps, without a change: each is the recording again.

`python benchmarks/branch.py [--steps 20] [--only two_link …] [--duration 3s] [--checkpoint 500ms]`
records each scenario once, in one process, with checkpoints, branches it at random steps, seeded by
its name, half from checkpoints and half from step 0, and prints a table. Exit code 1 where one
differs.
"""

import argparse
import random
import statistics
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import stepbus

TWO_LINK = ("pd", "pid", "pd_gravity", "velocity_force", "encoders", "tip", "pair")
STORE = ("truth", "heavy", "jammed", "dead_camera", "no_path", "obstacle", "spiral")
SCENARIOS = (
    "two_link",
    *(f"two_link/{name}" for name in TWO_LINK),
    "baxter",
    "baxter/round_trip",
    "store",
    *(f"store/{name}" for name in STORE),
)


class Found(NamedTuple):
    """One branch. way_s: to its step [s]. reason: why it is not the recording; empty: it is."""

    at: int
    way_s: float
    restored: Sequence[str]
    reason: str


def patience(scenario: str) -> list[str]:
    """Return overrides with which a busy machine is no participant's fault."""
    specs = stepbus.load(scenario).participants
    return [f"{spec.name}.step_timeout=120s" for spec in specs]


def branches(recording: Path, scenario: str, count: int, folder: Path) -> Iterator[Found]:
    """Yield branches at random steps, every second one from step 0."""
    last = stepbus.Recording(recording).last_step
    steps = random.Random(f"15/{scenario}").sample(range(1, last + 1), min(count, last))
    for number, at in enumerate(steps):
        with tempfile.TemporaryDirectory(dir=folder) as out:
            outcome = stepbus.branch(
                recording,
                Path(out) / "out",
                at=at,
                set=patience(scenario),
                in_process=True,
                checkpoints=number % 2 == 0,
            )
            reason = outcome.result.reason if outcome.result.exit_code else "another hash"
            yield Found(at, outcome.way_s, list(outcome.restored), "" if outcome.equal else reason)


def measure(scenario: str, args: argparse.Namespace, folder: Path) -> str:
    """Record a scenario and branch it; return a row of the table."""
    settings = [f"duration={args.duration}", f"checkpoint={args.checkpoint}", *patience(scenario)]
    out = folder / scenario.replace("/", "-")
    result = stepbus.run(scenario, set=settings, out=out, in_process=True)
    branches_made = list(branches(out / "run.mcap", scenario, args.steps, folder))
    wrong = [f"step {one.at}: {one.reason}" for one in branches_made if one.reason]
    saved = sorted({name for one in branches_made for name in one.restored})
    cells = (
        scenario,
        result.steps,
        f"{result.wall_s:.2f}",
        f"{len(branches_made) - len(wrong)} of {len(branches_made)}",
        _way(branches_made[1::2]),
        _way(branches_made[::2]),
        ", ".join(saved) or "none",
        "; ".join(wrong),
    )
    return f"| {' | '.join(map(str, cells))} |"


def _way(branches_made: Sequence[Found]) -> str:
    """Return the mean step of some branches, and the median time to get there."""
    if not branches_made:
        return ""
    at = statistics.fmean(one.at for one in branches_made)
    return f"{statistics.median(one.way_s for one in branches_made):.3f} s to step {at:.0f}"


def main() -> int:
    """Print the table; return 1 where a branch is not the recording."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument("--only", nargs="*", default=SCENARIOS)
    parser.add_argument("--duration", default="3s")
    parser.add_argument("--checkpoint", default="500ms")
    args = parser.parse_args()
    _say("| Scenario | steps | run [s] | equal | from step 0 | from checkpoints | saved by | |")
    _say("|---|---|---|---|---|---|---|---|")
    rows = []
    with tempfile.TemporaryDirectory(prefix="branch-stepbus-") as folder:
        for scenario in args.only:
            rows.append(measure(scenario, args, Path(folder)))
            _say(rows[-1])
    return int(any(not row.endswith("|  |") for row in rows))


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
