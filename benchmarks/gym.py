"""Steps/s of a Gymnasium environment, beside runs in one process without a recording.

    python -m benchmarks.gym [--rounds 5] [--steps 4000]

Both make the same steps of two_link, in turns, each on one core. What counts is the ratio in each
round: by the wall clock, and by the time of the processor, which other programs disturb less.
"""

import argparse
import dataclasses
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from stepbus_gym import StepbusEnv
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options
from stepbus_orchestrator.run.run_scenario import run as run_scenario
from stepbus_orchestrator.scenario.load import load

Speed = tuple[float, float]
"""Steps/s by the wall clock, and by the processor's."""


def environment(steps: int) -> Speed:
    """Return the speed of an episode: start-up, every step and the end."""
    with_duration = f"{steps * 5}ms"
    env = StepbusEnv("two_link", reward=lambda _moment: 0.0, duration=with_duration)
    try:
        return _speed(steps, lambda: _episode(env))
    finally:
        env.close()


def _episode(env: StepbusEnv) -> None:
    env.reset(seed=0)
    action, is_over = np.zeros(2), False
    while not is_over:
        *_, is_over, _info = env.step(action)


def in_process(steps: int) -> Speed:
    """Return the speed of the same scenario, with the controller that ships."""
    scenario = dataclasses.replace(load("two_link"), steps=steps)
    with tempfile.TemporaryDirectory() as folder:
        options = Options(out=Path(folder) / "run", host=InProcess(), is_recorded=False)
        return _speed(steps, lambda: run_scenario(scenario, options))


def _speed(steps: int, work: Callable[[], object]) -> Speed:
    wall, processor = time.perf_counter(), time.process_time()
    work()
    return steps / (time.perf_counter() - wall), steps / (time.process_time() - processor)


def main() -> None:
    """Print the figures of each round, and the median ratio."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=4000)
    args = parser.parse_args()
    rows = []
    for number in range(args.rounds):
        ours, plain = environment(args.steps), in_process(args.steps)
        rows.append([a / b for a, b in zip(ours, plain, strict=True)])
        print(
            f"round {number}: environment {ours[0]:.0f} steps/s, in process {plain[0]:.0f}; "
            f"ratio {rows[-1][0]:.2f}, of processor time {rows[-1][1]:.2f}"
        )
    wall, processor = map(statistics.median, zip(*rows, strict=True))
    print(f"median ratio {wall:.2f}, of processor time {processor:.2f}")


if __name__ == "__main__":
    main()
