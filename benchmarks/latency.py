"""Steps/s and processor time of the store with a picture every 12 steps, by the camera's latency.

    python benchmarks/latency.py [--rounds 5] [--steps 300]

Each round runs every latency once, in separate processes and in one.
"""

import argparse
import resource
import shutil
import statistics
import sys
import tempfile
from pathlib import Path

import stepbus_store
from stepbus_orchestrator.run.run_scenario import Options, host_of
from stepbus_orchestrator.run.run_scenario import run as run_scenario
from stepbus_orchestrator.scenario.load import load

STORE = Path(stepbus_store.__file__).parent / "scenarios/store"
LATENCIES = ("", "160ms", "288ms")
REQUESTS = {
    "      camera: mission.camera    # it takes images on request\n": "",
    ",\n       request: {from: mission.camera, delay: 1}": "",
}


def write_store(folder: Path, latency: str) -> Path:
    """Write the store with a camera that takes pictures by itself; return its scenario."""
    shutil.copytree(STORE, folder)
    _replace(folder / "scenario.yaml", REQUESTS)
    late = f", latency: {latency}" if latency else ""
    _replace(folder / "world.yaml", {"period: 400ms}": f"period: 192ms{late}}}"})
    return folder / "scenario.yaml"


def _replace(path: Path, texts: dict[str, str]) -> None:
    text = path.read_text()
    for old, new in texts.items():
        if text.count(old) != 1:
            sys.exit(
                f"{path} must contain {old!r} exactly once; update this script to the changed store"
            )
        text = text.replace(old, new)
    path.write_text(text)


def measure(scenario: Path, out: Path, steps: int, *, in_process: bool) -> tuple[float, float]:
    """Return steps/s of a run, and processor time of all its processes, with their start [s]."""
    before = _processor_s()
    loaded = load(scenario, [f"duration={16 * steps}ms"])
    result = run_scenario(loaded, Options(out=out, host=host_of(in_process=in_process)))
    if result.exit_code:
        sys.exit(result.reason)
    return result.steps / result.wall_s, _processor_s() - before


def _processor_s() -> float:
    used = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(row.ru_utime + row.ru_stime for row in used)


def main() -> None:
    """Print the median of each case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=300)
    args = parser.parse_args()
    cases = [(latency, in_process) for in_process in (False, True) for latency in LATENCIES]
    found: dict[tuple[str, bool], list[tuple[float, float]]] = {case: [] for case in cases}
    with tempfile.TemporaryDirectory() as folder:
        scenarios = {row: write_store(Path(folder, row or "none"), row) for row in LATENCIES}
        for number in range(args.rounds):
            for n, (latency, in_process) in enumerate(cases):
                out = Path(folder, f"run{number}_{n}")
                figures = measure(scenarios[latency], out, args.steps, in_process=in_process)
                found[latency, in_process].append(figures)
    for (latency, in_process), rows in found.items():
        rate, processor = map(statistics.median, zip(*rows, strict=True))
        place = "one process" if in_process else "separate processes"
        print(f"latency {latency or 'none'}, {place}: {rate:.1f} steps/s, {processor:.2f} s")


if __name__ == "__main__":
    main()
