"""Before a run, and the run: `stepbus run`, `validate`, `describe` and `new`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from stepbus_orchestrator.cli.parameters import (
    GROUP,
    Duration,
    Folder,
    FoxglovePort,
    Names,
    ScenarioName,
    Set,
    Texts,
    command,
    number,
    read_by,
    step_or_time,
)

_STEPS = number("not a number of steps (1 or more)", 1)


@dataclass(frozen=True, kw_only=True)
class Changes:
    """What the command line changes of a scenario.

    Attributes
    ----------
    set
        override one value, e.g. controller.params.kp=80 or duration=2s; may be repeated
    window
        maximum steps in flight; 1: synchronous
    transport
        transport between the processes
    fault
        inject a fault, e.g. 'kill plant at 120', 'delay controller at 10 for 20ms' or 'random 3
        seed 1'; may be repeated (docs/faults.md)
    debug
        run a participant in this terminal without deadlines, for a debugger
    external
        wait for a participant that you start yourself, with `stepbus join TICKET`; default: a
        ticket in the folder of the run; may be repeated (docs/guide/running/attach.md)
    join_timeout
        how long to wait for external participants (default: the participant's spawn_timeout if
        set, else 2min)
    no_deadline
        disable the deadlines of a participant, e.g. one that you start in a debugger

    """

    set: Set = ()
    window: Annotated[int | None, read_by(_STEPS)] = None
    transport: Literal["unix", "tcp"] | None = None
    fault: Annotated[Texts, Parameter(metavar="FAULT")] = ()
    debug: Names = ()
    external: Annotated[Texts, Parameter(metavar="PARTICIPANT[=TICKET]")] = ()
    join_timeout: Annotated[float | None, Duration] = None
    no_deadline: Names = ()


@dataclass(frozen=True, kw_only=True)
class Views:
    """What shows the run while it goes on.

    Attributes
    ----------
    view
        show the live run in 3D in the browser (docs/guide/looking/viewing.md)
    no_open
        with --view, do not open a browser
    foxglove
        stream to Foxglove or Lichtblick over a WebSocket (default: any free port)

    """

    view: bool = False
    no_open: bool = False
    foxglove: FoxglovePort = None


_FACTOR = read_by(number("not a number from 0.001 to 1000", 1e-3, 1e3, float), metavar="[FACTOR]")
_NO_CHANGES, _NO_VIEWS = Changes(), Views()


@command(
    group="run",
    execute="stepbus_orchestrator.cli.run:run_command",
    is_run=True,
    bare={"--real-time": "1", "--foxglove": "0"},
)
def run_command(
    scenario: ScenarioName,
    /,
    *,
    changes: Annotated[Changes, GROUP] = _NO_CHANGES,
    out: Folder = None,
    real_time: Annotated[float | None, _FACTOR] = None,
    pause_at: Annotated[int | str | None, read_by(step_or_time, metavar="STEP")] = None,
    in_process: bool = False,
    degrees: bool = False,
    extensions: Annotated[Texts, Parameter(name="--with", metavar="FILE.py:CLASS")] = (),
    profile: bool = False,
    no_report: bool = False,
    json: bool = False,
    views: Annotated[Views, GROUP] = _NO_VIEWS,
) -> None:
    """Run a scenario and record it.

    Starts all participants of a scenario, steps them in lockstep, and records everything to
    run.mcap. Ctrl-C ends the run cleanly. In a terminal, p pauses and resumes, s makes one step, q
    stops; none of these affects the result. The exit code tells the cause of a failure
    (docs/exit-codes.md).

    Parameters
    ----------
    scenario
        a scenario file, a folder with a scenario.yaml, or a built-in scenario such as two_link or
        two_link/pd
    changes
        what the command line changes of the scenario
    out
        folder of this run (default: runs/<name>-<time>)
    real_time
        pace steps by the wall clock, at FACTOR times real time (default: 1), and count late steps
        (docs/guide/running/real_time.md)
    pause_at
        pause before this step, or time such as 6s; 0: before the first
    in_process
        run all participants in one process: faster, same recording
    degrees
        show the measured joint angles in degrees during the run
    extensions
        add your own extension to the run (docs/guide/writing/extension.md)
    profile
        measure how each step spends its time: compute, wait, transport, record
    no_report
        do not write report.html and report.png; print the figures only
    json
        print the result as JSON only
    views
        what shows the run while it goes on

    Examples
    --------
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


@command(group="run", execute="stepbus_orchestrator.cli.scenarios:validate_command")
def validate_command(
    scenario: ScenarioName,
    /,
    *,
    set: Set = (),
    steps: Annotated[int, read_by(number("not a number of steps (0 or more)", 0))] = 5,
    json: bool = False,
) -> None:
    """Check a scenario and show its schedule.

    Checks a scenario without running it, and lists all problems at once, with file, line and path.
    If there are none, the classes of stepbus load their worlds, laws and tasks once, and your own
    are imported, to find errors that only show then. Prints which participant publishes at which
    step, and how many shared-memory slots each bulk output takes.

    Parameters
    ----------
    scenario
        a scenario file, a folder with a scenario.yaml, or a built-in scenario such as two_link or
        two_link/pd
    set
        override one value, e.g. controller.params.kp=80 or duration=2s; may be repeated
    steps
        how many steps of the schedule to show
    json
        print the result as JSON only

    Examples
    --------
    $ stepbus validate two_link
    $ stepbus validate my/scenario.yaml --steps 20

    """


@command(group="run", execute="stepbus_orchestrator.cli.scenarios:describe_command")
def describe_command(scenario: ScenarioName, /, *, set: Set = (), json: bool = False) -> None:
    """List ports, joints and limits, without running a step.

    Starts every participant, waits until it has loaded its model, and prints its inputs and the
    descriptions of its outputs: names, types, modes, limits (rad, rad/s, N·m; - for none), and
    whether the motor of each joint is on. A motor is off in the modes passive and teleport, and
    when its effort limit is 0. Runs no step and records nothing. The exit codes are those of
    `stepbus run`.

    Parameters
    ----------
    scenario
        a scenario file, a folder with a scenario.yaml, or a built-in scenario such as two_link or
        two_link/pd
    set
        override one value, e.g. controller.params.kp=80 or duration=2s; may be repeated
    json
        print the result as JSON only

    Examples
    --------
    $ stepbus describe two_link
    $ stepbus describe two_link/pd --set plant.params.world=world.yaml
    $ stepbus describe two_link --json

    """


@command(group="run", execute="stepbus_orchestrator.cli.new:new_command")
def new_command(
    folder: Path,
    /,
    *,
    language: Annotated[str, Parameter(metavar="LANGUAGE")] = "python",
) -> None:
    """Create a scenario with your own controller.

    Creates a folder with a scenario that uses the built-in plant and mission, a robot model, and a
    small PD controller for you to modify, in the language of your choice. It runs without changes
    once you have installed what its README lists.

    Parameters
    ----------
    folder
        folder to create; may exist if it is empty
    language
        language of the controller: c, java, js, octave, python, rust

    Examples
    --------
    $ stepbus new my_scenario
    $ stepbus new --language octave my_scenario

    """
