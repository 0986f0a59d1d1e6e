"""`stepbus sweep`: many runs of one scenario, and one table of them."""

from typing import Annotated, Literal

from cyclopts import Parameter

from stepbus_orchestrator.cli.parameters import (
    Duration,
    Folder,
    ScenarioName,
    Set,
    Texts,
    command,
    number,
    read_by,
)

_Whole = int | str | None
"""What is no integer is told with all that is wrong with the sweep."""


@command(group="many", execute="stepbus_tools.commands.sweeping:sweep_command", is_run=True)
def sweep_command(
    scenario: ScenarioName,
    /,
    *,
    vary: Annotated[Texts, Parameter(metavar="AXIS")] = (),
    set: Set = (),
    samples: _Whole = None,
    sampling: str | None = None,
    seed: _Whole = None,
    repeats: _Whole = None,
    metrics: Annotated[Texts, Parameter(name="--metric", metavar="FILE.py:FUNCTION")] = (),
    optimize: Annotated[str | None, Parameter(metavar="METRIC")] = None,
    maximize: bool = False,
    trials: _Whole = None,
    batch: _Whole = None,
    out: Folder = None,
    jobs: Annotated[int, read_by(number("not a number of processes (1 or more)", 1))] = 0,
    keep: Literal["all", "failed", "none"] = "failed",
    timeout_s: Annotated[float, Duration, Parameter(name="--timeout")] = 0.0,
    retry: Annotated[
        int, read_by(number("not a number of retries (0 or more)", 0), metavar="N")
    ] = 0,
    address: str = "",
    json: bool = False,
) -> None:
    """Run a scenario many times with different values, and collect one table.

    Runs a scenario once for each combination of the values that you vary, on all cores or on a Ray
    cluster, and writes one row per run to results.parquet: the values, the outcome, metrics, and
    the SHA-256 of the recording. Run the same command again to resume an interrupted sweep. A
    failed run is a row too; the exit code is 0 once every run has its row.

    Parameters
    ----------
    scenario
        a scenario, as in `stepbus run`, or the YAML file of a sweep (docs/guide/running/sweeps.md)
    vary
        PATH=50:200:7, PATH=1:1000:4:log, PATH=a,b,c, 'PATH~normal(1, 0.1)', 'PATH=1,2 & PATH=3,4'
        (together), 'faults=none,kill plant at 100'; may be repeated
    set
        override one value in all runs, e.g. duration=2s; may be repeated
    samples
        number of samples from each distribution (~)
    sampling
        sampling method: random, latin, sobol or halton
    seed
        seed of the samples and the optimizer
    repeats
        runs per point, each with another seed
    metrics
        your own metric, a function of the recording; may be repeated
    optimize
        minimize this metric with Optuna, which chooses the points; axes: PATH=50:200[:log]
    maximize
        maximize the metric instead
    trials
        number of runs for --optimize
    batch
        number of runs that the optimizer proposes at once (default: 4)
    out
        folder of the sweep (default: one in sweeps/)
    jobs
        number of worker processes (default: all cores)
    keep
        recordings to keep
    timeout_s
        time limit of a run, e.g. 90s (default: none)
    retry
        how often to repeat a run that failed to start, died or timed out
    address
        address of a Ray cluster, e.g. auto or HOST:6379
    json
        print the result as JSON only

    Examples
    --------
    $ stepbus sweep two_link --vary controller.params.kp=50:200:7
    $ stepbus sweep two_link --samples 9 --vary 'controller.params.kp~normal(9, 1)'
    $ stepbus sweep two_link --vary controller.params.kp=10:400:log --optimize rmse
    $ stepbus sweep my_sweep.yaml --out sweeps/friction --keep all

    """
