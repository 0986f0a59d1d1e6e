"""What the lockstep costs, beside hand-written chains of the same messages.

Every case runs once per round, one after the other, so that a noisy machine hurts all alike; the
table shows the median over the rounds and its ratio to the bare Zenoh chain. Recording is on in
every stepbus figure. `python benchmarks/lockstep.py [ROUNDS]`.
"""

import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.table import Table

from stepbus_orchestrator import Options, Result, load
from stepbus_orchestrator import run_scenario as run

HERE = Path(__file__).parent
STEPS = 4000


def bare(transport: str) -> float:
    """Return the steps per second of a hand-written chain."""
    command = [sys.executable, str(HERE / "bare.py"), transport, str(STEPS)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=300)
    return float(done.stdout.split()[-1])


def lockstep(scenario: str, window: int) -> Result:
    """Return the result of a scenario of STEPS steps."""
    overrides = [f"duration={STEPS * 5}ms", f"window={window}", f"batch={max(1, window // 2)}"]
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        result = run(load(scenario, overrides), Options(out=Path(folder) / "run"))
    if result.exit_code:
        raise SystemExit(result.reason)
    return result


def rate(scenario: str, window: int) -> float:
    """Return the steps per second of a scenario."""
    result = lockstep(scenario, window)
    return result.steps / result.wall_s


def start_up(scenario: str) -> float:
    """Return the time from the call to the first step [s]."""
    return lockstep(scenario, 64).start_s


ECHO = str(HERE / "echo")
CASES: dict[str, Callable[[], float]] = {
    "bare Zenoh chain": lambda: bare("zenoh"),
    "bare pyzmq chain": lambda: bare("pyzmq"),
    "stepbus, same messages, window 64": lambda: rate(ECHO, 64),
    "stepbus, same messages, window 1": lambda: rate(ECHO, 1),
    "stepbus two_link, window 64": lambda: rate("two_link", 64),
    "stepbus two_link, window 1": lambda: rate("two_link", 1),
}


def main(rounds: int) -> None:
    """Run all cases round by round and print the table."""
    measured: dict[str, list[float]] = {name: [] for name in CASES}
    for number in range(rounds):
        for name, case in CASES.items():
            measured[name].append(case())
        sys.stderr.write(f"round {number + 1} of {rounds} done\n")
    table = Table(title=f"{STEPS} steps, median of {rounds} rounds")
    for column in ("case", "steps/s", "lowest", "highest", "of the bare chain"):
        table.add_column(column, justify="left" if column == "case" else "right")
    base = statistics.median(measured["bare Zenoh chain"])
    for name, rates in measured.items():
        middle = statistics.median(rates)
        table.add_row(
            name, f"{middle:.0f}", f"{min(rates):.0f}", f"{max(rates):.0f}", f"{middle / base:.2f}"
        )
    console = Console(width=100)
    console.print(table)
    console.print(f"from the call to the first step of two_link: {start_up('two_link'):.2f} s")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
