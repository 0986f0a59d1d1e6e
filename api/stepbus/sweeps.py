"""Many runs of one scenario."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Literal

from stepbus_orchestrator.scenario.override import Overrides, override_texts, yaml_text
from stepbus_tools.sweep import SweepProgress, SweepResult, Terms, default_name, find_spec
from stepbus_tools.sweep import sweep as run_sweep

Axes = Sequence[str] | Mapping[str, Any]
"""Axes as the command line has them, or path → values: a list, `50:200:7` or `~normal(1, 0.1)`."""


def sweep(
    scenario: str | PathLike[str],
    vary: Axes = (),
    *,
    set: Overrides = (),  # noqa: A002  as --set on the command line
    samples: int = 0,
    sampling: Literal["random", "latin", "sobol", "halton"] = "random",
    seed: int = 0,
    repeats: int = 1,
    metrics: Sequence[str] = (),
    optimize: str | None = None,
    maximize: bool = False,
    trials: int = 0,
    batch: int = 4,
    out: str | PathLike[str] | None = None,
    jobs: int = 0,
    keep: Literal["all", "failed", "none"] = "failed",
    timeout_s: float = 0.0,
    retry: int = 0,
    address: str = "",
    on_progress: Callable[[SweepProgress], None] = lambda _progress: None,
    interrupt: threading.Event | None = None,
) -> SweepResult:
    """Run a scenario once for each point, and return one table; what is done already stays done.

    scenario: a name, a file or a folder, or the file of a sweep, of which the arguments replace a
    part (docs/guide/running/sweeps.md). vary: the axes, `["controller.params.kp=50:200:7"]` or
    `{"controller.params.kp": [50, 100], "controller.params.kd": "~uniform(10, 20)"}`. metrics:
    `FILE.py:FUNCTION`. out: folder of the sweep; default: one in `sweeps/`, the same for the same
    sweep. jobs: processes; default: all cores. timeout_s: limit of a run [s]; 0: none. retry: how
    often a run is repeated that died, did not start or was late. address: of a Ray cluster. All
    others: as of `stepbus sweep`.

    Raises ScenarioError or WiringError with every problem, RecordingFailed where the folder holds
    another sweep or cannot be written, StartFailed where Ray does not start, Interrupted.
    """
    given = {
        "set": override_texts(set),
        "vary": _axes(vary),
        "samples": samples,
        "sampling": "" if sampling == "random" else sampling,
        "seed": seed,
        "repeats": 0 if repeats == 1 else repeats,
        "metrics": list(metrics),
        "optimize": optimize,
        "maximize": maximize,
        "trials": trials,
        "batch": 0 if batch == 4 else batch,
    }
    spec = find_spec(fspath(scenario), {key: value for key, value in given.items() if value})
    terms = Terms(
        home=Path("sweeps") / default_name(spec) if out is None else Path(out),
        jobs=jobs,
        keep=keep,
        timeout_s=timeout_s,
        retries=retry,
        address=address,
    )
    return run_sweep(spec, terms, on_progress, interrupt)


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
