"""`stepbus run`: run a scenario, show its progress and its result."""

import argparse
import threading
from contextlib import nullcontext
from pathlib import Path

from stepbus_orchestrator.cli.after_run import after_run_lines, load_after_run
from stepbus_orchestrator.cli.command import Command, add_foxglove, add_scenario_arguments, number
from stepbus_orchestrator.cli.keys import controlled, has_terminal
from stepbus_orchestrator.cli.live import displayed
from stepbus_orchestrator.cli.output import print_error, say, say_json
from stepbus_orchestrator.cli.signals import abortable, interruptible, settle
from stepbus_orchestrator.cli.viewer import viewed
from stepbus_orchestrator.processes.limits import check_limits
from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.extensions import load_extension
from stepbus_orchestrator.run.extensions.debug import Debug, check_names, without_deadlines
from stepbus_orchestrator.run.extensions.external import External, external_names
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.extensions.profile import Profile
from stepbus_orchestrator.run.extensions.real_time import RealTime
from stepbus_orchestrator.run.reports import Lateness, in_units
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import (
    Options,
    default_folder,
    host_of,
    run,
)
from stepbus_orchestrator.scenario import Scenario, check_installed, load
from stepbus_schemas import WiringError

# The summary repeats at most this many warnings; each was shown when it came.
_MOST_WARNINGS = 10
_NO_REPORT = "no plots  the report was interrupted; the recording and result.json are whole"


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scenario_arguments(parser)
    parser.add_argument("--out", type=Path, help="folder of this run (default: runs/<name>-<time>)")
    parser.add_argument(
        "--window",
        type=number("a number of steps, from 1 on", 1),
        help="steps in flight; 1: synchronous mode",
    )
    parser.add_argument("--transport", choices=("unix", "tcp"), help="how the processes are linked")
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="FAULT",
        help="inject a fault, e.g. 'kill plant at 120', 'delay controller at 10 for 20ms' or "
        "'random 3 seed 1'; may be repeated (docs/faults.md)",
    )
    parser.add_argument(
        "--debug",
        action="append",
        default=[],
        metavar="PARTICIPANT",
        help="give a participant this terminal and no deadlines, for a debugger",
    )
    parser.add_argument(
        "--external",
        action="append",
        default=[],
        metavar="PARTICIPANT[=TICKET]",
        help="wait for a participant that you start yourself, with `stepbus join TICKET`; default: "
        "the ticket is in the folder of the run; may be repeated (docs/guide/running/attach.md)",
    )
    parser.add_argument(
        "--join-timeout",
        metavar="DURATION",
        help="how long to wait for those (default: 2min, or the scenario's spawn_timeout)",
    )
    parser.add_argument(
        "--no-deadline",
        action="append",
        default=[],
        metavar="PARTICIPANT",
        help="give a participant no deadlines, e.g. one that you start in a debugger",
    )
    parser.add_argument(
        "--real-time",
        type=_factor,
        nargs="?",
        const=1.0,
        metavar="FACTOR",
        help="let steps begin on the wall clock's grid, FACTOR times as fast (default: 1), and "
        "count who is late (docs/guide/running/real_time.md)",
    )
    parser.add_argument(
        "--pause-at",
        type=number("a step, from 0 on", 0),
        metavar="STEP",
        help="pause before a step; 0: before the first",
    )
    parser.add_argument(
        "--in-process",
        action="store_true",
        help="host all participants in one process: quicker, the same recording",
    )
    parser.add_argument(
        "--degrees",
        action="store_true",
        help="show the measured angles of all joints in degrees while it runs",
    )
    parser.add_argument(
        "--with",
        action="append",
        default=[],
        dest="extensions",
        metavar="FILE.py:CLASS",
        help="add an extension of your own to the run (docs/guide/writing/extension.md)",
    )
    parser.add_argument(
        "--profile",
        action="store_true",
        help="measure where the time of each step goes: compute, wait, transport, record",
    )
    parser.add_argument(
        "--speedscope",
        action="append",
        default=[],
        metavar="PARTICIPANT",
        help="with --profile, sample the stack of a participant too, for speedscope.app",
    )
    parser.add_argument(
        "--no-report",
        action="store_true",
        help="make no report.html and no report.png, only figures",
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON only")
    parser.add_argument(
        "--view",
        action="store_true",
        help="show the run in 3D in the browser while it goes on (docs/guide/looking/viewing.md)",
    )
    parser.add_argument("--no-open", action="store_true", help="with --view, start no browser")
    add_foxglove(parser)


def _factor(text: str) -> float:
    try:
        factor = float(text)
    except ValueError:
        factor = 0.0
    if not 1e-3 <= factor <= 1e3:
        raise argparse.ArgumentTypeError(f"{text!r} is no number from 0.001 to 1000")
    return factor


def _overrides(args: argparse.Namespace) -> list[str]:
    """Return all overrides, those with an option of their own included."""
    extra = []
    if args.window is not None:
        extra += [f"window={args.window}", f"batch={max(1, args.window // 2)}"]
    if args.transport is not None:
        extra.append(f"bus.transport={args.transport}")
    extra += [f"{name}.start=external" for name in _externals(args)]
    return [*args.set, *extra]


def _externals(args: argparse.Namespace) -> dict[str, str]:
    """Return who is started by somebody else, each with the path of its ticket, or none."""
    rows = (text.partition("=") for text in args.external)
    return {name: path for name, _, path in rows}


def _load(args: argparse.Namespace) -> Scenario:
    """Return the scenario with all options that change it."""
    scenario = load(args.scenario, _overrides(args), args.fault)
    if args.join_timeout is not None:
        names = external_names(scenario)
        if not names:
            raise WiringError("--join-timeout is for participants with `start: external`")
        patient = [f"{name}.spawn_timeout={args.join_timeout}" for name in names]
        scenario = load(args.scenario, [*_overrides(args), *patient], args.fault)
    return without_deadlines(scenario, [*args.debug, *args.no_deadline])


def _execute(args: argparse.Namespace) -> int:
    # Else it would be the scenario that cannot be read.
    check_limits(1)
    scenario = _load(args)
    has_keys = has_terminal() and not (args.json or args.debug)
    if args.pause_at is not None and not (has_keys or args.view):
        raise WiringError(
            "--pause-at needs a terminal whose keys let the run continue, or --view; it excludes "
            "--json and --debug"
        )
    if args.speedscope and not args.profile:
        raise WiringError("--speedscope needs --profile")
    check_names(scenario, args.speedscope, "sample")
    check_installed(scenario)
    check_limits(len(scenario.participants))
    # Nobody reads the lines beside JSON, and they take as long as the recording of the run.
    is_read = not (args.json and args.no_report)
    if is_read:
        # NumPy ends this process where memory is short: rather now than behind a run.
        load_after_run()
    out = args.out or default_folder(scenario, Path("runs"))
    pace = Pace(args.pause_at)
    options = Options(
        out=out,
        host=host_of(in_process=args.in_process, owns_descriptors=not args.debug),
        extensions=[pace, *_extensions(args, scenario)],
    )
    with interruptible() as interrupt:
        display = displayed(
            scenario.name,
            quiet=args.json,
            plain=bool(args.debug),
            degrees=args.degrees,
            invites=bool(external_names(scenario)),
        )
        # A participant in a debugger reads the keys itself.
        keys = nullcontext() if args.json or args.debug else controlled(pace, interrupt)
        with viewed(out, _views(args), stays=has_keys, interrupt=interrupt):
            with display as shown, keys:
                result = run(scenario, options, shown, interrupt)
            lines = _report(result, interrupt, has_plots=not args.no_report) if is_read else []
            if args.json:
                say_json(result)
            else:
                _summarise(result, lines)
            settle()
    return result.exit_code


def _extensions(args: argparse.Namespace, scenario: Scenario) -> list[RunExtension]:
    tickets = {name: Path(path) for name, path in _externals(args).items() if path}
    extensions: list[RunExtension] = [External(tickets), Debug(args.debug, args.no_deadline)]
    if args.real_time is not None:
        extensions.append(RealTime(scenario.step_ns, args.real_time))
    extensions += [load_extension(name) for name in args.extensions]
    if args.profile:
        extensions.append(Profile(args.speedscope))
    return extensions


def _views(args: argparse.Namespace) -> list[list[str]]:
    """Return the options of the views to open."""
    views = [["--no-open"] if args.no_open else []] if args.view else []
    return views if args.foxglove is None else [*views, ["--foxglove", str(args.foxglove)]]


def _report(result: Result, interrupt: threading.Event, *, has_plots: bool) -> list[str]:
    """Make the plots, and return the lines of the summary about the recording."""
    if not result.recording.exists() or result.steps == 0:
        return []
    if interrupt.is_set() and not result.exit_code:
        return [_NO_REPORT]
    try:
        with abortable():
            return after_run_lines(result.recording, has_plots=has_plots)
    except KeyboardInterrupt:
        return [_NO_REPORT]


def _summarise(result: Result, lines: list[str]) -> None:
    if result.exit_code:
        print_error(result.reason)
    why = "" if result.exit_code or result.reason == "finished" else f" ({result.reason})"
    say(
        f"{result.scenario}: {result.outcome}{why} after {result.steps} steps of "
        f"{result.step_ns * 1e-6:g} ms"
    )
    if result.wall_s:
        say(
            f"wall time {result.wall_s:.2f} s ({result.steps / result.wall_s:.0f} steps/s), "
            f"real-time factor {result.real_time_factor:.2f}, start-up {result.start_s:.2f} s"
        )
    if result.real_time is not None:
        say(_lateness(result.real_time))
    for line in lines:
        say(line)
    dropped = ", ".join(f"{count} by {name}" for name, count in result.drops.items() if count)
    if dropped or result.unauthenticated:
        say(f"messages dropped: {dropped or 'none'}; unauthenticated: {result.unauthenticated}")
    for line in _warnings(result):
        say(line)
    if result.faults:
        say(f"faults injected: {', '.join(result.faults)}")
    if result.sha256:
        say(f"recording {result.recording}\n{result.hashes()}")


def _lateness(lateness: Lateness) -> str:
    held = ", ".join(f"{count} by {name}" for name, count in lateness.late.items())
    rows = ", ".join(
        f"{'more' if bound == 'more' else f'≤ {in_units(float(bound))}'}: {count}"
        for bound, count in lateness.histogram.items()
        if count
    )
    p50, p99, largest = map(in_units, (lateness.p50_us, lateness.p99_us, lateness.max_us))
    return (
        f"lateness  p50 {p50}, p99 {p99}, max {largest}; steps held past their time: "
        f"{held or 'none'}\n          {rows}"
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


COMMAND = Command(
    name="run",
    summary="run a scenario and record it",
    description="Starts every participant of a scenario, drives them in lockstep, and records "
    "everything to run.mcap. Ctrl-C ends the run cleanly. In a terminal, p pauses and continues, s "
    "makes one step, q stops; none of them affects the result. The exit code gives the cause of a "
    "failure (docs/exit-codes.md).",
    examples=(
        "stepbus run two_link",
        "stepbus run two_link/pd --set controller.params.kp=80 --set duration=2s",
        "stepbus run my/scenario.yaml --window 1 --out /tmp/run1",
        "stepbus run two_link --fault 'freeze controller at 500 for 200ms'",
        "stepbus run my/scenario.yaml --debug controller",
        "stepbus run two_link --view --real-time",
        "stepbus run two_link --foxglove 8765 --real-time",
        "stepbus run two_link --external controller",
        "stepbus run two_link --external controller=/tmp/c.ticket --no-deadline controller",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
    is_run=True,
)
