"""What is compared: `stepbus replay`, `rerun`, `verify`, `diff` and `branch`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from stepbus_orchestrator.cli.parameters import (
    GROUP,
    File,
    Folder,
    Names,
    ScenarioName,
    Set,
    Texts,
    command,
    number,
    read_by,
)

_Limits = Annotated[Texts, Parameter(metavar="[PORT[.FIELD]=]NUMBER")]


@dataclass(frozen=True, kw_only=True)
class ToleranceOptions:
    """How far values may differ.

    Attributes
    ----------
    abs
        absolute tolerance, e.g. 1e-9
    rel
        relative tolerance
    ignore
        ignore a port or field
    tolerance
        YAML file of tolerances (docs/guide/testing/replay.md)

    """

    abs: _Limits = ()
    rel: _Limits = ()
    ignore: Annotated[Texts, Parameter(metavar="PORT[.FIELD]")] = ()
    tolerance: File = None


_EXACT = ToleranceOptions()
_STEPS = number("not a number of steps (1 or more)", 1)


@command(
    group="test",
    execute="stepbus_orchestrator.cli.compare:replay_command",
    is_run=True,
    rest="--exec",
)
def replay_command(
    recording: Path,
    /,
    *,
    participant: Annotated[str, Parameter(metavar="NAME")],
    tolerance: Annotated[ToleranceOptions, GROUP] = _EXACT,
    set: Set = (),
    update: Annotated[Path | None, Parameter(metavar="OUT.mcap")] = None,
    window: Annotated[int, read_by(_STEPS)] = 256,
    recorded: bool = False,
    source: Folder = None,
    bridge: Literal["json", "msgpack", "raw"] | None = None,
    program: Annotated[Texts, Parameter(name="--exec", metavar="PROGRAM ...")] = (),
    trust: bool = False,
    json: bool = False,
) -> None:
    """Run one participant on its recorded inputs and compare its outputs.

    Starts one participant of a recorded run, or another program in its place, feeds it the recorded
    inputs in lockstep, and compares each output with the recorded one: byte for byte, or within a
    tolerance. Shows the first divergent step with its inputs. Uses the program of the scenario in
    --source, or else the copy in the recording. Exit code 0: equal, 10: different. A recorded
    program that differs from yours starts only with --trust.

    Parameters
    ----------
    recording
        a run.mcap, or the folder of its run
    participant
        participant to start
    tolerance
        how far values may differ
    set
        override one value of the recorded scenario, e.g. controller.params.kp=101
    update
        write a new reference recording
    window
        number of steps that recorded inputs are sent ahead
    recorded
        start the copy in the recording, not the program of the scenario
    source
        folder or file of the scenario (default: the file that result.json names, or else the
        current folder)
    bridge
        start the program through `stepbus bridge`
    program
        start this program instead of the recorded one, in the current folder; all following
        arguments belong to it
    trust
        start the recorded programs, even if they are not those in your scenario's folder
    json
        print the result as JSON only

    Examples
    --------
    $ stepbus replay run.mcap --participant controller
    $ stepbus replay runs/arm --participant controller --set controller.params.kp=9
    $ stepbus replay runs/arm --participant controller --abs 1e-9 --exec ./mine
    $ stepbus replay run.mcap --participant controller --update new.mcap

    """


@command(group="test", execute="stepbus_orchestrator.cli.rerun:rerun_command", is_run=True)
def rerun_command(
    recording: Path,
    row: Annotated[int | None, read_by(number("not a run number (0 or higher)", 0))] = None,
    /,
    *,
    out: Folder = None,
    set: Set = (),
    trust: bool = False,
    json: bool = False,
) -> None:
    """Repeat a run from its recording alone.

    Extracts the scenario and its files from a recording into <out>/source, runs it, and compares
    the new recording with the old one, byte for byte. Lists what differs on this machine, such as
    versions. Exit code 0: all messages are equal, 10: at least one differs. A recording contains
    programs: those that are not in your scenario's folder start only with --trust.

    Parameters
    ----------
    recording
        a run.mcap, the folder of its run, or the folder of a sweep
    row
        number of a run in a sweep
    out
        folder of the new run (default: in runs/)
    set
        override one value, e.g. controller.params.kp=80 or duration=2s; may be repeated
    trust
        start the recorded programs, even if they are not those in your scenario's folder
    json
        print the result as JSON only

    Examples
    --------
    $ stepbus rerun runs/two_link-20250101-120000/run.mcap
    $ stepbus rerun run.mcap --set window=1 --out /tmp/again
    $ stepbus rerun sweeps/two_link 17

    """


@command(group="test", execute="stepbus_orchestrator.cli.verify:verify_command", is_run=True)
def verify_command(
    scenario: ScenarioName,
    /,
    *,
    set: Set = (),
    runs: Annotated[
        int, read_by(number("not a number of runs (2 or more)", 2), name="-n", metavar="RUNS")
    ] = 5,
    seed: Annotated[int, read_by(number("not a seed (an integer, 0 or higher)", 0))] = 0,
    out: Folder = None,
    json: bool = False,
) -> None:
    """Run a scenario several times and compare the recordings.

    Runs a scenario several times: once unchanged, then with shuffled start orders, random delays in
    every participant, and different windows and transports, and finally, if possible, with all
    participants in one process. All recordings must be byte-identical. Exit code 10: two differ;
    the first difference is shown.

    Parameters
    ----------
    scenario
        a scenario file, a folder with a scenario.yaml, or a built-in scenario such as two_link or
        two_link/pd
    set
        override one value, e.g. controller.params.kp=80 or duration=2s; may be repeated
    runs
        number of runs in separate processes
    seed
        seed of the start orders and delays
    out
        keep the runs in this new folder (default: a temporary one, which stays only where a run
        failed or differed)
    json
        print the result as JSON only

    Examples
    --------
    $ stepbus verify two_link
    $ stepbus verify two_link -n 10 --set duration=2s --seed 1

    """


@command(group="test", execute="stepbus_orchestrator.cli.compare:diff_command")
def diff_command(
    first: Path,
    second: Path,
    /,
    *,
    tolerance: Annotated[ToleranceOptions, GROUP] = _EXACT,
    json: bool = False,
) -> None:
    """Compare two recordings, port by port.

    Compares the messages of two recordings byte for byte, or within a tolerance. The recordings may
    differ in length or be truncated. Shows the first difference first. PORT is a topic such as
    controller/command. Exit code 0: equal, 10: different.

    Parameters
    ----------
    first
        a run.mcap, or the folder of its run
    second
        a run.mcap, or the folder of its run
    tolerance
        how far values may differ
    json
        print the result as JSON only

    Examples
    --------
    $ stepbus diff runs/a/run.mcap runs/b/run.mcap
    $ stepbus diff a.mcap b.mcap --abs controller/command.values=1e-9
    $ stepbus diff a.mcap b.mcap --tolerance tolerance.yaml --json

    """


@command(group="test", execute="stepbus_orchestrator.cli.branch:branch_command", is_run=True)
def branch_command(
    recording: Path,
    /,
    *,
    at: Annotated[str, Parameter(metavar="STEP")],
    out: Folder = None,
    set: Set = (),
    calls: Annotated[Texts, Parameter(name="--call", metavar="CALL")] = (),
    faults: Annotated[Texts, Parameter(name="--fault", metavar="FAULT")] = (),
    in_process: bool = False,
    no_checkpoints: bool = False,
    vary: Annotated[Texts, Parameter(metavar="PATH=VALUE,VALUE")] = (),
    plot: Annotated[Texts, Parameter(metavar="SIGNAL")] = (),
    debug: Names = (),
    no_report: bool = False,
    json: bool = False,
    trust: bool = False,
) -> None:
    """Replay a recording up to a step, then run live with your changes.

    Replays a recording up to a step, then continues as a live run with your changes. Until that
    step, every participant gets its recorded inputs as fast as it can process them and must publish
    the recorded outputs; the first one that diverges is reported (exit code 10). Without a change,
    the new recording is byte-identical to the old one. A changed participant also gets its recorded
    inputs; its own outputs are used from that step on. A recording contains programs: those
    that are not in your scenario's folder start only with --trust.

    Parameters
    ----------
    recording
        a run.mcap, or the folder of its run
    at
        the first live step, or its time, e.g. 6s
    out
        folder of the new run (default: in runs/)
    set
        change a parameter from that step on, e.g. controller.params.kp=90; may be repeated
    calls
        call a participant before that step, e.g. 'controller set kp 90'; may be repeated
    faults
        inject a fault at that step or later, e.g. 'freeze plant at 1300 for 200ms'
    in_process
        run all participants in one process: faster, same recording
    no_checkpoints
        replay from step 0, without the saved checkpoints
    vary
        make one branch per value, and one picture of all branches; may be repeated
    plot
        signal in that picture, as in `stepbus plot`; default: the joint errors
    debug
        run a participant in this terminal without deadlines, for a debugger
    no_report
        do not write report.html and report.png
    json
        print the result as JSON only
    trust
        start the recorded programs, even if they are not those in your scenario's folder

    Examples
    --------
    $ stepbus branch run.mcap --at 1200
    $ stepbus branch run.mcap --at 6s --set controller.params.kp=90
    $ stepbus branch run.mcap --at 1200 --vary controller.params.kp=50,100,200
    $ stepbus branch run.mcap --at 1200 --fault 'freeze plant at 1300 for 200ms'
    $ stepbus branch run.mcap --at 1200 --debug controller

    """
