"""`stepbus run`: run a scenario, show its progress and its result."""

import dataclasses
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path

from stepbus_orchestrator.cli.commands import Run
from stepbus_orchestrator.cli.interrupts import interruptible, interrupting
from stepbus_orchestrator.cli.terminal.keys import controlled, has_terminal
from stepbus_orchestrator.cli.terminal.live import displayed
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.cli.viewer import viewed
from stepbus_orchestrator.plugins import AFTER_RUN, points
from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.extensions import load_extension
from stepbus_orchestrator.run.extensions.debug import Debug
from stepbus_orchestrator.run.extensions.external import External, external_names
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.extensions.profile import Profile
from stepbus_orchestrator.run.extensions.real_time import RealTime
from stepbus_orchestrator.run.folder import default_folder
from stepbus_orchestrator.run.reports import Lateness, in_units
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, host_of, reaching, run
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_participant import parse_duration, whole_steps
from stepbus_schemas import StepbusError, WiringError

# The summary repeats at most this many warnings; each was shown when it came.
_MOST_WARNINGS = 10
_NO_REPORT = "no plots  the report was interrupted; the recording and result.json are complete"


def run_command(given: Run) -> int:
    """Run a scenario, show its progress, and print its result."""
    if given.watch:
        from stepbus_orchestrator.cli.watch import watch  # noqa: PLC0415  (other runs need it not)

        with interruptible(ends=True) as interrupt:
            return watch(given, _load, interrupt)
    loaded = _load(given)
    is_quiet = given.json or bool(given.debug)
    has_keys = has_terminal() and not is_quiet
    if given.pause_at and not (has_keys or given.view):
        raise WiringError(
            "--pause-at needs --view or an interactive terminal to resume the run; it "
            "cannot be combined with --json or --debug"
        )
    # Beside JSON, the lines have no reader, and they take as long as the recording of the run.
    is_read = not (given.json and given.no_report)
    for point in points(AFTER_RUN) if is_read else ():
        point.load()
    pace = Pace(step_of(given.pause_at, loaded.step_ns))
    elsewhere, adapting = reaching(loaded, given.hosts, given.listen)
    options = Options(
        out=given.out,
        host=host_of(
            in_process=given.in_process, owns_descriptors=not given.debug, elsewhere=elsewhere
        ),
        extensions=[pace, *_extensions(given, loaded.step_ns), *adapting],
    )
    display = displayed(
        loaded.name,
        quiet=given.json,
        plain=bool(given.debug),
        degrees=given.degrees,
        invites=bool(external_names(loaded)),
        keys=has_keys,
    )
    with interruptible(ends=True) as interrupt, ExitStack() as stack:
        if given.view:
            out = given.out or stack.enter_context(_made_before(loaded))
            options = dataclasses.replace(options, out=out)
            opens = not given.no_open
            view = viewed(out, opens=opens, stays=has_keys, interrupt=interrupt)
            stack.enter_context(view)
        # A participant in a debugger reads the keys itself.
        keys = nullcontext() if is_quiet else controlled(pace, interrupt)
        with display as shown, keys:
            result = run(loaded, options, shown, interrupt)
        has_plots = not given.no_report
        lines = (
            after_run(result, has_plots=has_plots, is_interrupted=interrupt.is_set())
            if is_read
            else []
        )
        error = result.reason if result.exit_code else ""
        Answer(value=result, lines=summary(result, lines), error=error).show(as_json=given.json)
    return result.exit_code


@contextmanager
def _made_before(scenario: Scenario) -> Iterator[Path]:
    """Make the default folder of a run, whose view needs the path; remove it if it stays empty."""
    folder = default_folder(scenario, Path("runs"))
    try:
        yield folder
    finally:
        with suppress(OSError):
            folder.rmdir()
            folder.parent.rmdir()


def _load(given: Run) -> Scenario:
    """Return the scenario with all that the options change of it."""
    overrides = [*given.set]
    if given.window is not None:
        overrides += [f"window={given.window}", f"batch={max(1, given.window // 2)}"]
    if given.transport is not None:
        overrides.append(f"bus.transport={given.transport}")
    overrides += [f"{text.partition('=')[0]}.start=external" for text in given.external]
    scenario = load(given.scenario, overrides, given.faults)
    if given.join_timeout:
        names = external_names(scenario)
        if not names:
            raise WiringError("--join-timeout is for participants with `start: external`")
        scenario = scenario.changed(names, spawn_timeout_ns=parse_duration(given.join_timeout))
    return scenario


def step_of(text: str, step_ns: int) -> int | None:
    """Return a step from its number or its time; None where there is none."""
    return int(text) if text.isdecimal() else whole_steps(text, step_ns) if text else None


def _extensions(given: Run, step_ns: int) -> Iterator[RunExtension]:
    rows = (text.partition("=") for text in given.external)
    yield External({name: Path(path) for name, _, path in rows if path})
    yield Debug(given.debug, given.no_deadline)
    if given.real_time is not None:
        yield RealTime(step_ns, *(given.real_time or [1.0]))
    yield from map(load_extension, given.extensions)
    if given.profile:
        yield Profile()


def after_run(result: Result, *, has_plots: bool, is_interrupted: bool = False) -> list[str]:
    """Call what installed packages do after a run, such as a report; return their summary lines."""
    if not result.recording.exists() or result.steps == 0:
        return []
    if is_interrupted and not result.exit_code:
        return [_NO_REPORT]
    lines: list[str] = []
    try:
        with interrupting():
            for point in points(AFTER_RUN):
                lines += point.load()(result.recording, has_plots=has_plots)
    except KeyboardInterrupt:
        return [_NO_REPORT]
    except (StepbusError, OSError, MemoryError) as exc:
        lines.append(f"no report {str(exc) or 'out of memory'}")
    return lines


def summary(result: Result, lines: Sequence[str]) -> Iterator[str]:
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
