"""What the bridge adds to a step, beside a native Python participant in the same run of cases.

The controller of `echo` is replaced by the examples in C and JavaScript. Every case runs once per
round, one after the other, so that a noisy machine hurts all alike. Shown is the median over the
rounds of each round's p50. `python benchmarks/bridge.py [ROUNDS]`.
"""

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter_ns
from typing import NamedTuple

import msgspec
from mcap.reader import make_reader
from rich.console import Console
from rich.table import Table

from stepbus_orchestrator.recording.timing import StepTiming
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

HERE = Path(__file__).parent
EXAMPLES = HERE.parent / "examples/controllers"
STEPS = 4000
WARM_UP = 500
ROUND_TRIPS = 20_000
TARGET_US = 40

CASES: dict[str, tuple[str, ...]] = {
    "native Python": (),
    "bridge, C, msgpack": ("controller.exec=[./controller]", "controller.bridge=msgpack"),
    "bridge, Node, json": ("controller.exec=[node, controller.mjs]", "controller.bridge=json"),
}


class Cost(NamedTuple):
    """p50 of one run [µs]: a whole step of the plant, and what the controller needs of it."""

    step: float
    controller: float


def prepare(folder: Path) -> None:
    """Put the scenario and all controllers into one folder."""
    subprocess.run(["make", "-s", "-C", str(EXAMPLES / "c")], check=True)
    for file in (HERE / "echo/scenario.yaml", HERE / "echo/echo.py"):
        shutil.copy(file, folder)
    for file in (EXAMPLES / "c/controller", EXAMPLES / "javascript/controller.mjs"):
        shutil.copy(file, folder)


def measure(folder: Path, out: Path, overrides: tuple[str, ...], window: int) -> Cost:
    """Return what a step costs in one run."""
    settings = [
        f"duration={STEPS * 5}ms",
        f"window={window}",
        f"batch={max(1, window // 2)}",
        "controller.params={kp: 200, kd: 30}",
        *overrides,
    ]
    result = run(load(folder, settings), Options(out=out))
    if result.exit_code:
        raise SystemExit(result.reason)
    rows = read_rows(out / "timing.mcap")
    steps = [waited + computed for _, waited, computed in rows["plant"][WARM_UP:]]
    work = [computed for _, _, computed in rows["controller"][WARM_UP:]]
    return Cost(statistics.median(steps) * 1e-3, statistics.median(work) * 1e-3)


def read_rows(path: Path) -> dict[str, list[tuple[int, int, int]]]:
    """Return (step, waited [ns], computed [ns]) of each participant."""
    rows: dict[str, list[tuple[int, int, int]]] = {}
    decode = msgspec.msgpack.Decoder(StepTiming).decode
    with path.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages(topics=["steps"]):
            record = decode(message.data)
            rows.setdefault(record.participant, []).extend(record.rows)
    return rows


def ping_pong() -> float:
    """Return the round trip over two bare pipes between two Python processes [µs]."""
    code = "import os\nwhile d := os.read(0, 256): os.write(1, d)"
    command = [sys.executable, "-S", "-c", code]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as echo:
        if echo.stdin is None or echo.stdout is None:
            raise SystemExit("no pipes")
        to, back, data = echo.stdin.fileno(), echo.stdout.fileno(), b"x" * 200
        times = timed(lambda: (os.write(to, data), os.read(back, 256)))
    return statistics.median(times)


def timed(call: Callable[[], object]) -> list[float]:
    """Return how long each of many calls takes [µs]."""
    times = []
    for _ in range(ROUND_TRIPS):
        start = perf_counter_ns()
        call()
        times.append((perf_counter_ns() - start) * 1e-3)
    return times


def table(window: int, measured: dict[str, list[Cost]]) -> Table:
    """Return a table of one window."""
    base = measured["native Python"]
    shown = Table(title=f"window {window}: p50 [µs], median of {len(base)} rounds, {STEPS} steps")
    for column in ("controller", "computing", "ratio", "added", "step", "ratio", "added"):
        shown.add_column(column, justify="left" if column == "controller" else "right")
    native = Cost(*(statistics.median(column) for column in zip(*base, strict=True)))
    for name, costs in measured.items():
        cost = Cost(*(statistics.median(column) for column in zip(*costs, strict=True)))
        cells = []
        for own, other in ((cost.controller, native.controller), (cost.step, native.step)):
            cells += [f"{own:.0f}", f"{own / other:.2f}", f"{own - other:+.0f}"]
        shown.add_row(name, *cells)
    return shown


def main(rounds: int) -> None:
    """Run all cases round by round and print the tables."""
    console = Console(width=100)
    with tempfile.TemporaryDirectory(prefix="bench-") as name:
        folder = Path(name) / "scenario"
        folder.mkdir()
        prepare(folder)
        pipes = []
        measured: dict[int, dict[str, list[Cost]]] = {w: {c: [] for c in CASES} for w in (64, 1)}
        for number in range(rounds):
            pipes.append(ping_pong())
            for window, cases in measured.items():
                for case, overrides in CASES.items():
                    out = Path(name) / f"run-{number}-{window}-{case.replace(' ', '-')}"
                    cases[case].append(measure(folder, out, overrides, window))
            sys.stderr.write(f"round {number + 1} of {rounds} done\n")
    for window, cases in measured.items():
        console.print(table(window, cases))
    console.print(f"two bare pipes, Python to Python and back: {statistics.median(pipes):.0f} µs")
    console.print(f"target: the bridge adds at most {TARGET_US} µs to a step")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
