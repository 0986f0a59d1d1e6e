"""60 s of two_link at 200 Hz in real time: `python benchmarks/real_time.py [--duration 60s]`.

Prints lateness (p50, p99, max), who held steps past their time, and whether the recording is that
of the run without `--real-time`. Nothing else should run on the machine.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path

import stepbus


def main() -> int:
    """Run once as fast as it goes and once in real time; return 1 where the bytes differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", default="60s")
    args = parser.parse_args()
    wanted = [f"duration={args.duration}"]
    with tempfile.TemporaryDirectory(prefix="real-time-stepbus-") as folder:
        plain = stepbus.run("two_link", set=wanted, out=Path(folder) / "plain")
        load = os.getloadavg()[0]
        timed = stepbus.run("two_link", set=wanted, out=Path(folder) / "timed", real_time=1.0)
    late = timed.real_time
    if timed.exit_code or late is None:
        sys.stdout.write(f"failed: {timed.reason}\n")
        return 1
    held = ", ".join(f"{name} {count}" for name, count in late.late.items()) or "none"
    same = timed.sha256 == plain.sha256
    sys.stdout.write(
        f"two_link, {timed.steps} steps of 5 ms on {os.cpu_count()} cores, load {load:.1f} at the "
        f"start\nas fast as it goes: {plain.wall_s:.2f} s\nin real time: {timed.wall_s:.2f} s\n"
        f"lateness: p50 {late.p50_us:.0f} µs, p99 {late.p99_us:.0f} µs, max {late.max_us:.0f} µs\n"
        f"histogram [µs]: {late.histogram}\nsteps held past their time: {held}\n"
        f"the same bytes: {'yes' if same else 'NO'}\n"
    )
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
