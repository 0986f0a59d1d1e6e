"""`stepbus run`: run a scenario, show its progress and its result."""

import threading
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from stepbus_orchestrator.cli.parameters import (
    DURATION,
    Folder,
    FoxglovePort,
    Json,
    ScenarioName,
    Set,
    command,
    number,
    step_or_time,
)
from stepbus_orchestrator.cli.signals import REPORT_THREAD, interruptible
from stepbus_orchestrator.cli.terminal.keys import controlled, has_terminal
from stepbus_orchestrator.cli.terminal.live import displayed
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.cli.viewer import viewed
from stepbus_orchestrator.plugins import AFTER_RUN, points
from stepbus_orchestrator.processes.limits import check_limits
from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.extensions import load_extension
from stepbus_orchestrator.run.extensions.debug import Debug, without_deadlines
from stepbus_orchestrator.run.extensions.external import External, external_names
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.extensions.profile import Profile
from stepbus_orchestrator.run.extensions.real_time import RealTime
from stepbus_orchestrator.run.reports import Lateness, in_units
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, default_folder, host_of, run
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.program import check_installed
from stepbus_participant import format_duration, whole_steps
from stepbus_schemas import StepbusError, WiringError

# The summary repeats at most this many warnings; each was shown when it came.
_MOST_WARNINGS = 10
_POLL_S = 0.1
_NO_REPORT = "no plots  the report was interrupted; the recording and result.json are complete"

Names = Annotated[Sequence[str], {"metavar": "PARTICIPANT"}]


@dataclass(frozen=True, kw_only=True)
class Changes:
    """What the command line changes of a scenario.

    window: maximum steps in flight; 1: synchronous. transport: transport between the processes.
    fault: inject a fault, e.g. 'kill plant at 120', 'delay controller at 10 for 20ms' or 'random 3
    seed 1'; may be repeated (docs/faults.md). debug: run a participant in this terminal without
    deadlines, for a debugger. external: wait for a participant that you start yourself, with
    `stepbus join TICKET`; default: a ticket in the folder of the run; may be repeated
    (docs/guide/running/attach.md). join_timeout: how long to wait for external participants
    (default: the participant's spawn_timeout if set, else 2min). no_deadline: disable the deadlines
    of a participant, e.g. one that you start in a debugger.
    """

    set: Set = ()
    window: Annotated[int | None, {"type": number("not a number of steps (1 or more)", 1)}] = None
    transport: Literal["unix", "tcp"] | None = None
    fault: Annotated[Sequence[str], {"metavar": "FAULT"}] = ()
    debug: Names = ()
    external: Annotated[Sequence[str], {"metavar": "PARTICIPANT[=TICKET]"}] = ()
    join_timeout: Annotated[float | None, DURATION] = None
    no_deadline: Names = ()

    def load(self, name: str) -> Scenario:
        """Return the scenario with all of them."""
        overrides = [*self.set]
        if self.window is not None:
            overrides += [f"window={self.window}", f"batch={max(1, self.window // 2)}"]
        if self.transport is not None:
            overrides.append(f"bus.transport={self.transport}")
        overrides += [f"{text.partition('=')[0]}.start=external" for text in self.external]
        scenario = load(name, overrides, self.fault)
        if self.join_timeout is not None:
            names = external_names(scenario)
            if not names:
                raise WiringError("--join-timeout is for participants with `start: external`")
            wait = format_duration(round(self.join_timeout * 1e9))
            overrides += [f"{name}.spawn_timeout={wait}" for name in names]
            scenario = load(name, overrides, self.fault)
        return without_deadlines(scenario, [*self.debug, *self.no_deadline])

    def extensions(self) -> list[RunExtension]:
        """Return the extensions that they need."""
        rows = (text.partition("=") for text in self.external)
        tickets = {name: Path(path) for name, _, path in rows if path}
        return [External(tickets), Debug(self.debug, self.no_deadline)]


@dataclass(frozen=True, kw_only=True)
class Views:
    """What shows the run while it goes on.

    view: show the live run in 3D in the browser (docs/guide/looking/viewing.md). no_open: with
    --view, do not open a browser.
    """

    view: bool = False
    no_open: bool = False
    foxglove: FoxglovePort = None

    def options(self) -> list[list[str]]:
        """Return the options of each view, as of `stepbus view`."""
        page = [["--no-open"] if self.no_open else []] if self.view else []
        return page if self.foxglove is None else [*page, ["--foxglove", str(self.foxglove)]]


_FACTOR = {
    "type": number("not a number from 0.001 to 1000", 1e-3, 1e3, float),
    "nargs": "?",
    "const": 1.0,
    "metavar": "FACTOR",
}


@command(group="run", is_run=True)
def run_command(
    scenario: ScenarioName,
    *,
    changes: Changes,
    out: Folder = None,
    real_time: Annotated[float | None, _FACTOR] = None,
    pause_at: Annotated[int | str | None, {"type": step_or_time, "metavar": "STEP"}] = None,
    in_process: bool = False,
    degrees: bool = False,
    extensions: Annotated[Sequence[str], {"flag": "--with", "metavar": "FILE.py:CLASS"}] = (),
    profile: bool = False,
    no_report: bool = False,
    json: Json = False,
    views: Views,
) -> int:
    """Run a scenario and record it.

    Starts all participants of a scenario, steps them in lockstep, and records everything to
    run.mcap. Ctrl-C ends the run cleanly. In a terminal, p pauses and resumes, s makes one step, q
    stops; none of these affects the result. The exit code tells the cause of a failure
    (docs/exit-codes.md).

    out: folder of this run (default: runs/<name>-<time>). real_time: pace steps by the wall clock,
    at FACTOR times real time (default: 1), and count late steps (docs/guide/running/real_time.md).
    pause_at: pause before this step, or time such as 6s; 0: before the first. in_process: run all
    participants in one process: faster, same recording. degrees: show the measured joint angles in
    degrees during the run. extensions: add your own extension to the run
    (docs/guide/writing/extension.md). profile: measure how each step spends its time: compute,
    wait, transport, record. no_report: do not write report.html and report.png; print the figures
    only.

    $ stepbus run two_link
    $ stepbus run two_link/pd --set controller.params.kp=80 --set duration=2s
    $ stepbus run my/scenario.yaml --window 1 --out /tmp/run1
    $ stepbus run two_link --fault 'freeze controller at 500 for 200ms'
    $ stepbus run my/scenario.yaml --debug controller
    $ stepbus run two_link --view --real-time
    $ stepbus run two_link --foxglove 8765 --real-time
    $ stepbus run two_link --external controller
    $ stepbus run two_link --external controller=/tmp/c.ticket
    """
    # Else it would be the scenario that cannot be read.
    check_limits(1)
    loaded = changes.load(scenario)
    is_quiet = json or bool(changes.debug)
    has_keys = has_terminal() and not is_quiet
    if pause_at is not None and not (has_keys or views.view):
        raise WiringError(
            "--pause-at needs --view or an interactive terminal to resume the run; it "
            "cannot be combined with --json or --debug"
        )
    check_installed(loaded)
    check_limits(len(loaded.participants))
    # Beside JSON, the lines have no reader, and they take as long as the recording of the run.
    is_read = not (json and no_report)
    if is_read:
        _load_after_run()
    at = whole_steps(pause_at, loaded.step_ns) if isinstance(pause_at, str) else pause_at
    pace = Pace(at)
    own: list[RunExtension] = [] if real_time is None else [RealTime(loaded.step_ns, real_time)]
    own += [load_extension(name) for name in extensions]
    own += [Profile()] if profile else []
    options = Options(
        out=out or default_folder(loaded, Path("runs")),
        host=host_of(in_process=in_process, owns_descriptors=not changes.debug),
        extensions=[pace, *changes.extensions(), *own],
    )
    display = displayed(
        loaded.name,
        quiet=json,
        plain=bool(changes.debug),
        degrees=degrees,
        invites=bool(external_names(loaded)),
        keys=has_keys,
    )
    with interruptible(ends=True) as interrupt:
        # A participant in a debugger reads the keys itself.
        keys = nullcontext() if is_quiet else controlled(pace, interrupt)
        with viewed(options.out, views.options(), stays=has_keys, interrupt=interrupt):
            with display as shown, keys:
                result = run(loaded, options, shown, interrupt)
            lines = (
                after_run(result, has_plots=not no_report, is_interrupted=interrupt.is_set())
                if is_read
                else []
            )
            error = result.reason if result.exit_code else ""
            Answer(value=result, lines=_summary(result, lines), error=error).show(as_json=json)
    return result.exit_code


@cache
def _load_after_run() -> list[Any]:
    return [point.load() for point in points(AFTER_RUN)]


def after_run(result: Result, *, has_plots: bool, is_interrupted: bool = False) -> list[str]:
    """Write what installed packages do, such as a report; return what they say of the run."""
    if not result.recording.exists() or result.steps == 0:
        return []
    if is_interrupted and not result.exit_code:
        return [_NO_REPORT]
    lines: list[str] = []
    # A thread can be left alone; an exception might be swallowed, as in a destructor.
    thread = threading.Thread(
        target=_call_after_run, args=(result, has_plots, lines), name=REPORT_THREAD, daemon=True
    )
    thread.start()
    with interruptible() as interrupt:
        while thread.is_alive() and not interrupt.is_set():
            thread.join(_POLL_S)
    return [_NO_REPORT] if interrupt.is_set() else lines


def _call_after_run(result: Result, has_plots: bool, lines: list[str]) -> None:
    try:
        for call in _load_after_run():
            lines += call(result.recording, has_plots=has_plots)
    except (StepbusError, OSError, MemoryError) as exc:
        lines.append(f"no report {str(exc) or 'out of memory'}")


def _summary(result: Result, lines: Sequence[str]) -> Iterator[str]:
    """Yield the lines of the summary; lines: of the recording."""
    why = "" if result.exit_code or result.reason == "finished" else f" ({result.reason})"
    yield (
        f"{result.scenario}: {result.outcome}{why} after {result.steps} steps of "
        f"{result.step_ns * 1e-6:g} ms"
    )
    if result.wall_s:
        yield (
            f"wall time {result.wall_s:.2f} s ({result.steps / result.wall_s:.0f} steps/s), "
            f"real-time factor {result.real_time_factor:.2f}, start-up {result.start_s:.2f} s"
        )
    if result.real_time is not None:
        yield _lateness(result.real_time)
    yield from lines
    dropped = ", ".join(f"{count} by {name}" for name, count in result.drops.items() if count)
    if dropped or result.unauthenticated:
        yield f"messages dropped: {dropped or 'none'}; unauthenticated: {result.unauthenticated}"
    yield from _warnings(result)
    if result.faults:
        yield f"faults injected: {', '.join(result.faults)}"
    if result.sha256:
        yield f"recording {result.recording}\n{result.hashes()}"


def _lateness(lateness: Lateness) -> str:
    held = ", ".join(f"{count} by {name}" for name, count in lateness.late.items())
    rows = ", ".join(
        f"{'more' if bound == 'more' else f'≤ {in_units(float(bound))}'}: {count}"
        for bound, count in lateness.histogram.items()
        if count
    )
    p50, p99, largest = map(in_units, (lateness.p50_us, lateness.p99_us, lateness.max_us))
    return (
        f"lateness  p50 {p50}, p99 {p99}, max {largest}; late steps: {held or 'none'}\n          "
        f"{rows}"
    )


def _warnings(result: Result) -> list[str]:
    """Return the warnings of the run, the first few in full."""
    if not result.warning_count:
        return []
    shown = result.warnings[:_MOST_WARNINGS]
    lines = [f"  {warned.level}: {warned.source}: {warned.text}" for warned in shown]
    if result.warning_count > len(shown):
        lines.append(f"  and {result.warning_count - len(shown)} more, in result.json")
    return [f"warnings  {result.warning_count}", *lines]
