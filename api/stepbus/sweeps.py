"""Sweeps: many runs of one scenario."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Literal

from stepbus_orchestrator.scenario.override import Overrides, override_texts, yaml_text
from stepbus_tools.sweep.axes import Sampling
from stepbus_tools.sweep.pool import PoolOptions
from stepbus_tools.sweep.run_sweep import SweepProgress, SweepResult
from stepbus_tools.sweep.run_sweep import sweep as run_sweep
from stepbus_tools.sweep.spec import default_name, plan

Axes = Sequence[str] | Mapping[str, Any]
"""Axes as the command line has them, or path → values: a list, `50:200:7` or `~normal(1, 0.1)`."""


def sweep(
    scenario: str | PathLike[str],
    vary: Axes = (),
    *,
    set: Overrides = (),  # noqa: A002  as --set on the command line
    samples: int | None = None,
    sampling: Sampling | None = None,
    seed: int | None = None,
    repeats: int | None = None,
    metrics: Sequence[str] = (),
    optimize: str | None = None,
    maximize: bool = False,
    trials: int | None = None,
    batch: int | None = None,
    out: str | PathLike[str] | None = None,
    jobs: int = 0,
    keep: Literal["all", "failed", "none"] = "failed",
    timeout_s: float = 0.0,
    retry: int = 0,
    address: str = "",
    on_progress: Callable[[SweepProgress], None] = lambda _progress: None,
    interrupt: threading.Event | None = None,
) -> SweepResult:
    """Run a scenario once per point and return one table; resume the sweep if it was interrupted.

    scenario: a scenario, as in `stepbus run`, or the YAML file of a sweep
    (docs/guide/running/sweeps.md). Arguments override the file. vary: PATH=50:200:7,
    PATH=1:1000:4:log, PATH=a,b,c, 'PATH~normal(1, 0.1)', 'PATH=1,2 & PATH=3,4' (together),
    'faults=none,kill plant at 100'; may be repeated. In Python a map too: `{"controller.params.kp":
    [50, 100], "controller.params.kd": "~uniform(10, 20)"}`. set: override one value in all runs,
    e.g. duration=2s; may be repeated. samples: number of samples from each distribution (~).
    sampling: sampling method: random, latin, sobol or halton. seed: seed of the samples and the
    optimizer. repeats: runs per point, each with another seed. metrics: your own metric, a function
    of the recording; may be repeated. optimize: minimize this metric with Optuna, which chooses the
    points; axes: PATH=50:200[:log]. maximize: maximize the metric instead. trials: number of runs
    for --optimize. batch: number of runs that the optimizer proposes at once (default: 4). out:
    folder of the sweep (default: one in sweeps/). The same sweep always gets the same default
    folder. jobs: number of worker processes (default: all cores). keep: recordings to keep.
    timeout_s: time limit of a run [s] (default: none). retry: how often to repeat a run that failed
    to start, died or timed out. address: address of a Ray cluster, e.g. auto or HOST:6379.
    on_progress: called with the progress. interrupt: as in `run`.

    Raises ScenarioError or WiringError with every problem, RecordingFailed when the folder contains
    another sweep or cannot be written, StartFailed when the workers do not start, Interrupted.
    """
    given = {
        "set": override_texts(set),
        "vary": _axes(vary),
        "samples": samples,
        "sampling": sampling,
        "seed": seed,
        "repeats": repeats,
        "metrics": list(metrics),
        "optimize": optimize,
        "maximize": maximize or None,
        "trials": trials,
        "batch": batch,
    }
    declared = {key: value for key, value in given.items() if value is not None and value != []}
    planned = plan(fspath(scenario), declared)
    options = PoolOptions(
        home=Path("sweeps") / default_name(planned.spec) if out is None else Path(out),
        jobs=jobs,
        keep=keep,
        timeout_s=timeout_s,
        retries=retry,
        address=address,
    )
    return run_sweep(planned, options, on_progress, interrupt)


def _axes(vary: Axes) -> list[str]:
    """Return axes as texts."""
    if not isinstance(vary, Mapping):
        return list(vary)
    return [_axis(path, values) for path, values in vary.items()]


def _axis(path: str, values: Any) -> str:
    if isinstance(values, str):
        return f"{path}{values}" if values.startswith("~") else f"{path}={values}"
    texts = [values] if not isinstance(values, list | tuple | range) else values
    return f"{path}={','.join(map(yaml_text, texts))}"
