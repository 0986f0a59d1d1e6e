"""`make bench`: every case once per round, in turn, so that a noisy machine hurts all alike.

`python -m benchmarks.suite [--rounds N] [--only TEXT]… [--out FOLDER] [--page FILE]`. What has been
measured is kept in FOLDER/measured.jsonl, one line each; an interrupted suite goes on from there.
Processor time (user and system, of all processes) and wake-ups (how often a thread had to wait) are
those of a long run less those of a short one, so that the start-up is in neither. The peers are
installed into FOLDER/peers.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

from .cases import BENCHMARKS, Case, all_cases
from .clock import machine
from .page import write_page

_PEERS = ("helics==3.6.1", "mosaik==3.6.0")
_PICTURE_PEERS = (
    *("dora-rs==1.1.0", "dora-rs-cli==1.1.0", "pyarrow==26.0.1"),
    *("iceoryx2==0.10.0", "flatbuffers==25.12.19"),
)
"""Without what they depend on, which would come before ours: NumPy is here already."""
_LONGEST_S = 300


def install_peers(folder: Path) -> None:
    """Install the peers that are no dependencies of stepbus; what does not come is left out."""
    if folder.exists():
        return
    pip = [sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    subprocess.run([*pip, "--target", str(folder), *_PEERS], check=False)
    pictures = str(folder.with_name("picture-peers"))
    subprocess.run([*pip, "--no-deps", "--target", pictures, *_PICTURE_PEERS], check=False)


def run(
    case: Case, steps: int, environment: dict[str, str]
) -> tuple[dict[str, Any], resource.struct_rusage]:
    """Return what a case prints, and what all its processes used."""
    command = [*case.command, str(steps)]
    with subprocess.Popen(
        command,
        cwd=BENCHMARKS.parent,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        text = process.stdout.read() if process.stdout is not None else ""
        # Its own time and that of all it has waited for.
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    lines = [line for line in text.splitlines() if line.startswith("{")]
    if process.returncode or not lines:
        raise RuntimeError(f"{case.name}: {' '.join(command)} ended with {process.returncode}")
    return json.loads(lines[-1]), usage


def measure(case: Case, environment: dict[str, str]) -> dict[str, Any]:
    """Return the figures of a case, and what the machine was doing meanwhile."""
    shown, long = run(case, case.steps, environment)
    _, short = run(case, case.few_steps, environment)
    steps = case.steps - case.few_steps
    return shown | {
        "cpu_us": 1e6 * (_cpu_s(long) - _cpu_s(short)) / steps,
        "wake_ups": (long.ru_nvcsw - short.ru_nvcsw) / steps,
        "start_cpu_s": _cpu_s(short),
        "load": os.getloadavg()[0],
    }


def _cpu_s(usage: resource.struct_rusage) -> float:
    return usage.ru_utime + usage.ru_stime


def main() -> None:
    """Measure what is missing, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--only", action="append", help="cases whose name contains this")
    parser.add_argument("--out", type=Path, default=BENCHMARKS.parent / "build/bench")
    parser.add_argument("--page", type=Path, default=BENCHMARKS.parent / "docs/performance.md")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    install_peers(args.out / "peers")
    peers = [str(args.out.resolve() / name) for name in ("peers", "picture-peers")]
    path = os.pathsep.join([str(BENCHMARKS.parent), *peers])
    environment = {**os.environ, "PYTHONPATH": path}
    kept = args.out / "measured.jsonl"
    rows = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    done = {(row["round"], row["case"]) for row in rows if "failed" not in row}
    cases = all_cases()
    for number in range(args.rounds):
        for case in cases if number % 2 == 0 else reversed(cases):
            is_wanted = not args.only or any(text in case.name for text in args.only)
            if (number, case.name) in done or not is_wanted:
                continue
            row = {"round": number, "case": case.name, "machine": machine()}
            try:
                row |= measure(case, environment)
            except RuntimeError as exc:
                row["failed"] = str(exc)
            rows.append(row)
            with kept.open("a") as file:
                file.write(json.dumps(row) + "\n")
            sys.stderr.write(f"{number + 1}/{args.rounds} {case.name}: {_short(row)}\n")
    write_page(args.page, [case.name for case in cases], rows)


def _short(row: dict[str, Any]) -> str:
    if "failed" in row:
        return str(row["failed"])
    return f"{row['rate']:.0f} steps/s, {row['cpu_us']:.0f} µs of processor time a step"


if __name__ == "__main__":
    main()
