"""Steps per second with the controller on another host, against round-trip time.

    PYTHONPATH=tests python -m benchmarks.hosts [--steps N] [--quick]

two_link, with plant and mission on one host and the controller on another: two network namespaces,
joined by a router that delays packets (`tests/support/wan.py`; needs root). Rows: round-trip time.
Columns: window, and the `delay` of the controller's input and of the plant's.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from support.wan import Wan

_STEPBUS = str(Path(sys.executable).with_name("stepbus"))
_SCENARIO = Path("scenarios/stepbus_scenarios/two_link")
_RTT_MS = (0.0, 1.0, 10.0, 50.0)
_WINDOWS = (1, 8, 64, 512)
_DELAYS = (0, 1, 8)
_SECONDS = 2.0
"""About how long a run takes."""


def rate(wan: Wan, window: int, delay: int, steps: int, rtt_ms: float) -> float:
    """Return the steps per second of one run; raises RuntimeError where it fails."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        there = shutil.copytree(_SCENARIO, folder / "two_link")
        ticket = folder / "controller.ticket"
        command = [
            *(_STEPBUS, "run", "two_link", "--out", str(folder / "run"), "--json", "--no-report"),
            *("--external", f"controller={ticket}", "--listen", wan.addresses[0]),
            *("--window", str(window), "--set", f"duration={steps * 5}ms"),
            *("--set", f"plant.inputs.command={{from: controller.command, delay: {delay}}}"),
            *("--set", "controller.step_timeout=60s", "--set", "plant.step_timeout=60s"),
        ]
        run = wan.start(0, *command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        while not ticket.exists():
            if run.poll() is not None:
                raise RuntimeError(run.communicate()[1])
            time.sleep(0.02)
        joined = wan.start(
            1,
            *(_STEPBUS, "join", str(ticket)),
            cwd=there,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        said, problem = run.communicate()
        joined.wait()
        result = json.loads(said)
        if result["exit_code"]:
            raise RuntimeError(f"{rtt_ms} ms, window {window}, delay {delay}: {problem}")
        return float(result["steps"] / result["wall_s"])


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rtt", type=float, nargs="+", default=_RTT_MS, help="[ms]")
    parser.add_argument("--windows", type=int, nargs="+", default=_WINDOWS)
    parser.add_argument("--delays", type=int, nargs="+", default=_DELAYS)
    given = parser.parse_args(arguments)
    columns = [(window, delay) for delay in given.delays for window in given.windows]
    print("| RTT | " + " | ".join(f"w{w} d{d}" for w, d in columns) + " |")
    print("|---" * (len(columns) + 1) + "|")
    with Wan(2) as wan:
        for rtt_ms in given.rtt:
            wan.shape(delay_s=rtt_ms / 2e3)
            cells = []
            for window, delay in columns:
                guess = 1500 if rtt_ms < 1 else min(1500, max(1, delay) * 1000 / rtt_ms)
                steps = int(max(40, guess * _SECONDS))
                cells.append(f"{rate(wan, window, delay, steps, rtt_ms):.0f}")
            print(f"| {rtt_ms:g} ms | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
