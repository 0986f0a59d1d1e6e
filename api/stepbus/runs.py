"""Load, run, verify and describe scenarios, and call participants of a live run."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from stepbus_orchestrator.analysis.verify import Verification
from stepbus_orchestrator.analysis.verify import verify as verify_scenario
from stepbus_orchestrator.run.describe import ParticipantDescription
from stepbus_orchestrator.run.describe import describe as describe_scenario
from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.extensions.external import External
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.extensions.real_time import RealTime
from stepbus_orchestrator.run.live_file import call as call_run
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, host_of, reaching
from stepbus_orchestrator.run.run_scenario import run as run_scenario
from stepbus_orchestrator.scenario.load import load as load_scenario
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.override import Overrides, override_texts, plain_value
from stepbus_schemas import CallReply, StepbusError, WiringError

AnyScenario = str | PathLike[str] | Mapping[str, Any] | Scenario
"""A scenario: a built-in name, the path of a file or folder, a map like a file, or a loaded one."""


def load(
    scenario: AnyScenario,
    *,
    set: Overrides = (),  # noqa: A002  as --set on the command line
    faults: Sequence[str] = (),
    folder: str | PathLike[str] | None = None,
) -> Scenario:
    """Load and check a scenario without starting a process.

    scenario: a built-in name such as `two_link`, the path of a YAML file or its folder, or a map
    with the keys of a scenario file (docs/reference/scenario.md), in which message classes stand
    for their names. set: `{"controller.params.kp": 80}` or `["controller.params.kp=80"]`. faults:
    strings such as `kill plant at 120`. folder: base of relative file names in a map; default: the
    current folder.

    ```python
    plant = {"participant": "stepbus_plant:Plant", "outputs": {"joint_state": stepbus.JointState}}
    swing = {"name": "swing", "step": "5ms", "duration": "2s", "participants": {"plant": plant}}
    ```

    Raises ScenarioError with every problem, each with file, line and path.
    """
    if isinstance(scenario, Mapping):
        given = None if folder is None else Path(folder)
        return load_scenario(plain_value(scenario), override_texts(set), faults, folder=given)
    if folder is not None:
        raise WiringError(
            "folder: only valid with a scenario given as a map; a scenario file has its own folder"
        )
    if isinstance(scenario, Scenario):
        if set or faults:
            raise WiringError(
                f"{scenario.name} is already loaded; pass `set` and `faults` to stepbus.load"
            )
        return scenario
    return load_scenario(Path(scenario), override_texts(set), faults)


def run(
    scenario: AnyScenario,
    *,
    set: Overrides = (),  # noqa: A002  as --set on the command line
    out: str | PathLike[str] | None = None,
    faults: Sequence[str] = (),
    observer: Observer | None = None,
    pace: Pace | None = None,
    interrupt: threading.Event | None = None,
    in_process: bool = False,
    external: Mapping[str, str | PathLike[str]] | None = None,
    hosts: str | PathLike[str] | None = None,
    listen: str = "",
    real_time: float | None = None,
    report: bool = False,
    extensions: Sequence[RunExtension] = (),
) -> Result:
    """Run a scenario and return its result; a failed run also returns, with its exit code.

    scenario, set, faults: as in `load`. out: new folder of the run; default:
    `runs/<scenario>-<time>`. observer: reports progress and warnings. pace: pauses and steps the
    run. interrupt: event that ends the run when set, from any thread. in_process: run all
    participants in this process, on its main thread, which is faster and records the same bytes
    (docs/guide/running/in_process.md). external: participants that you start
    with `stepbus join`, each with the path of its ticket (docs/guide/running/attach.md); the
    tickets of others with `start: external` are in `out`. hosts: file that says where the hosts of
    the scenario are; listen: address and port for other hosts (docs/guide/running/hosts.md).
    real_time: pace steps by the wall clock,
    as a factor of real time (docs/guide/running/real_time.md); `result.real_time` has their
    lateness. extensions: your own extensions (docs/guide/writing/extension.md).

    Raises ScenarioError when the scenario cannot run, ExtraMissing when a built-in participant
    needs a package that is not installed, OutputExists when `out` already contains a run,
    RecordingFailed when the recording cannot be written.
    """
    if real_time is not None and not 1e-3 <= real_time <= 1e3:
        raise WiringError(f"real_time must be a factor from 0.001 to 1000, not {real_time}")
    loaded = load(scenario, set=set, faults=faults)
    tickets = {name: Path(path) for name, path in (external or {}).items()}
    loaded = loaded.changed(tickets, start="external")
    elsewhere, adapting = reaching(loaded, None if hosts is None else Path(hosts), listen)
    chosen: list[RunExtension] = [External(tickets), *adapting, *extensions]
    if pace is not None:
        chosen.append(pace)
    if real_time is not None:
        chosen.append(RealTime(loaded.step_ns, float(real_time)))
    options = Options(
        out=None if out is None else Path(out),
        host=host_of(in_process=in_process, elsewhere=elsewhere),
        extensions=chosen,
    )
    result = run_scenario(loaded, options, observer, interrupt)
    if report and result.steps and result.recording.exists():
        from stepbus_tools.viewing.page import write_page  # noqa: PLC0415  (when asked)

        try:
            write_page([result.recording])
        except StepbusError as exc:
            # The run is over, whatever becomes of its page.
            warnings.warn(f"no report: {exc}", stacklevel=2)
    return result


def describe(
    scenario: AnyScenario,
    *,
    set: Overrides = (),  # noqa: A002  as --set on the command line
) -> list[ParticipantDescription]:
    """Start every participant, run no step, and return its ports, joints and limits.

    scenario, set: as in `load`. Raises RunFailure when a participant cannot start.
    """
    return describe_scenario(load(scenario, set=set))


def verify(
    scenario: AnyScenario,
    *,
    runs: int = 5,
    seed: int = 0,
    set: Overrides = (),  # noqa: A002  as --set on the command line
    out: str | PathLike[str] | None = None,
) -> Verification:
    """Run a scenario several times, with different start orders, delays, windows and transports.

    runs: number of runs, at least 2. seed: seed of the start orders and delays. out: a new folder
    for the runs; default: a temporary one, kept only if a run failed or differed.
    """
    return verify_scenario(load(scenario, set=set), runs=runs, seed=seed, out=out)


def call(
    folder: str | PathLike[str], participant: str = "", method: str = "", *args: Any
) -> CallReply:
    """Call a participant of a live run; it answers between two steps.

    folder: folder of the run. Without a participant and a method, the reply's value lists all
    calls. args: numbers, strings, lists, maps.

    Raises WiringError when the folder has no live run or the call is refused, BusFailed when the
    run does not answer.
    """
    return call_run(Path(folder), participant, method, args)
