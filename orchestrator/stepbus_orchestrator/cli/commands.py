"""The commands of the core."""

from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from .options import (
    EITHER,
    FLAT,
    BridgeFormat,
    Command,
    Count,
    Duration,
    Faults,
    File,
    Folder,
    Index,
    Json,
    Names,
    NewRun,
    NoReport,
    Recording,
    Scenario,
    Set,
    Settings,
    Texts,
    Trust,
)

_Factor = Annotated[float, Parameter(validator=Number(gte=1e-3, lte=1e3))]
_Limits = Annotated[Texts, Parameter(metavar="[PORT[.FIELD]=]NUMBER")]


class Run(Command, work="run_command", group="run", is_run=True):
    """Run a scenario and record it.

    Starts all participants of a scenario, steps them in lockstep, and records everything to
    run.mcap. Ctrl-C ends the run cleanly. In a terminal, p pauses and resumes, s makes one step, q
    stops; none of these affects the result. The exit code tells the cause of a failure
    (docs/exit-codes.md).

    $ stepbus run two_link
    $ stepbus run two_link/pd --set controller.params.kp=80 --set duration=2s
    $ stepbus run my/scenario.yaml --window 1 --out /tmp/run1
    $ stepbus run two_link --fault 'freeze controller at 500 for 200ms'
    $ stepbus run my/scenario.yaml --debug controller
    $ stepbus run two_link --view --real-time
    $ stepbus run my/scenario.yaml --watch
    $ stepbus run two_link --external controller
    $ stepbus run two_link --external controller=/tmp/c.ticket
    $ stepbus run two_link --external controller --listen 192.0.2.7
    $ stepbus run two_link --hosts hosts.yaml --set controller.host=robot
    """

    scenario: Scenario
    _: KW_ONLY
    set: Set = ()
    window: Count | None = None
    """maximum steps in flight; 1: synchronous"""
    transport: Literal["unix", "tcp"] | None = None
    """transport between the processes"""
    faults: Faults = ()
    """inject a fault, e.g. 'kill plant at 120', 'delay controller at 10 for 20ms' or 'random 3 seed
    1'; may be repeated (docs/faults.md)"""
    debug: Names = ()
    """run a participant in this terminal without deadlines, for a debugger"""
    external: Annotated[Texts, Parameter(metavar="PARTICIPANT[=TICKET]")] = ()
    """wait for a participant that you start yourself, with `stepbus join TICKET`; default: a ticket
    in the folder of the run; `-`: print it as one line to copy; may be repeated
    (docs/guide/running/attach.md)"""
    hosts: File = None
    """where the hosts are on which participants of the scenario run (`host:`); they are reached by
    SSH (docs/guide/running/hosts.md)"""
    listen: Annotated[str, Parameter(metavar="ADDRESS[:PORT]")] = ""
    """open one port for participants on other hosts, also for those that you start there yourself
    with a ticket (default: as the first of --hosts was reached, any free port)"""
    join_timeout: Duration = ""
    """how long to wait for external participants (default: the participant's spawn_timeout if set,
    else 2min)"""
    no_deadline: Names = ()
    """disable the deadlines of a participant, e.g. one that you start in a debugger"""
    out: Folder = None
    """folder of this run (default: runs/<name>-<time>)"""
    real_time: Annotated[
        tuple[_Factor, ...] | None, Parameter(consume_multiple=(0, 1), metavar="[FACTOR]")
    ] = None
    """pace steps by the wall clock, at FACTOR times real time (default: 1), and count late steps
    (docs/guide/running/real_time.md)"""
    pause_at: Annotated[str, Parameter(metavar="STEP")] = ""
    """pause before this step, or time such as 6s; 0: before the first"""
    in_process: bool = False
    """run all participants in one process: faster, same recording"""
    degrees: bool = False
    """show the measured joint angles in degrees during the run"""
    extensions: Annotated[Texts, Parameter(name="--with", metavar="FILE.py:CLASS")] = ()
    """add your own extension to the run (docs/guide/writing/extension.md)"""
    profile: bool = False
    """measure how each step spends its time: compute, wait, transport, record"""
    no_report: bool = False
    """do not write report.html and report.png; print the figures only"""
    json: Json = False
    view: bool = False
    """show the live run in 3D in the browser (docs/guide/looking/viewing.md)"""
    no_open: bool = False
    """with --view, do not open a browser"""
    watch: bool = False
    """run again when the scenario or a file of it changes, until Ctrl-C; the runs are numbered
    folders in --out (default: runs/<name>-watch)"""


class Validate(Command, work="scenarios", group="run"):
    """Check a scenario and show its schedule.

    Checks a scenario without running it, and lists all problems at once, with file, line and path.
    If there are none, the classes of stepbus load their worlds, laws and tasks once, and your own
    are imported, to find errors that only show then. Prints which participant publishes at which
    step, and how many shared-memory slots each bulk output takes.

    $ stepbus validate two_link
    $ stepbus validate my/scenario.yaml --steps 20
    """

    scenario: Scenario
    _: KW_ONLY
    set: Set = ()
    steps: Index = 5
    """how many steps of the schedule to show"""
    json: Json = False


class Describe(Command, work="scenarios", group="run"):
    """List ports, joints and limits, without running a step.

    Starts every participant, waits until it has loaded its model, and prints its inputs and the
    descriptions of its outputs: names, types, modes, limits (rad, rad/s, N·m; - for none), and
    whether the motor of each joint is on. A motor is off in the modes passive and teleport, and
    when its effort limit is 0. Runs no step and records nothing. The exit codes are those of
    `stepbus run`.

    $ stepbus describe two_link
    $ stepbus describe two_link/pd --set plant.params.world=world.yaml
    $ stepbus describe two_link --json
    $ stepbus describe two_link --graph wiring.svg
    """

    scenario: Scenario
    _: KW_ONLY
    set: Set = ()
    graph: Annotated[
        tuple[Path, ...] | None, Parameter(consume_multiple=(0, 1), metavar="[FILE]")
    ] = None
    """print a picture of the wiring as text for Mermaid, or write it to FILE: SVG if it is .svg"""
    json: Json = False


class New(Command, work="new", group="run"):
    """Create a scenario with your own controller.

    Creates a folder with a scenario that uses the built-in plant and mission, a robot model, and a
    small PD controller for you to modify, in the language of your choice. It runs without changes
    once you have installed what its README lists.

    $ stepbus new my_scenario
    $ stepbus new --language octave my_scenario
    $ stepbus new --fmu motor.fmu my_motor
    """

    folder: Path
    """folder to create; may exist if it is empty"""
    _: KW_ONLY
    language: Annotated[Literal["c", "java", "js", "octave", "python", "rust"], EITHER] = "python"
    """language of the controller; the bridge connects programs in any language
    (docs/guide/writing/bridge.md)"""
    fmu: Annotated[File, EITHER] = None
    """make a scenario of this FMU instead, with its parameters and inputs
    (docs/guide/writing/fmu.md)"""


class Info(Command, work="info", group="look"):
    """Summarize a recording.

    Shows the scenario, the outcome, the length, the participants, the messages and the versions.
    Needs only the recording; result.json next to it adds outcome and wall time. For a truncated
    recording, shows where it ends.

    $ stepbus info runs/arm
    $ stepbus info run.mcap --json
    """

    recording: Recording
    _: KW_ONLY
    json: Json = False


class Types(Command, work="scenarios", group="look"):
    """Show message types, or write their schemas and byte vectors.

    Shows the fields of message types with units and shapes, and their layout in the bridge's raw
    format. With --out, writes test data for programs in other languages: JSON Schemas, and byte
    vectors that a codec must read and write.

    $ stepbus types
    $ stepbus types types.yaml --out types
    """

    source: str = ""
    """a scenario with its own types, a YAML file of types, or an installed module of message
    classes (default: the built-in types)"""
    _: KW_ONLY
    out: Folder = None
    """write messages.md, vectors.json and a JSON Schema for each type"""
    json: Json = False


class Recover(Command, work="info", group="look"):
    """Recover a truncated or corrupt recording.

    Reads an MCAP file up to its first damaged record and writes the intact part to a new file, with
    attachments, metadata and a new index. Reports what was lost.

    $ stepbus recover runs/two_link-20250101-120000/run.mcap
    $ stepbus recover broken.mcap --out fixed.mcap
    $ stepbus recover broken.mcap --in-place
    """

    recording: Path
    """the MCAP file to read, or the folder of a run"""
    _: KW_ONLY
    out: Annotated[File, EITHER] = None
    """the file to write (default: <recording>.recovered.mcap)"""
    in_place: Annotated[bool, EITHER] = False
    """replace the original file"""
    json: Json = False


@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """How far values may differ."""

    abs: _Limits = ()
    """absolute tolerance, e.g. 1e-9"""
    rel: _Limits = ()
    """relative tolerance"""
    ignore: Annotated[Texts, Parameter(metavar="PORT[.FIELD]")] = ()
    """ignore a port or field"""
    tolerance: File = None
    """YAML file of tolerances (docs/guide/testing/replay.md)"""


class Replay(Command, work="compare", group="test", is_run=True):
    """Run one participant on its recorded inputs and compare its outputs.

    Starts one participant of a recorded run, or another program in its place, feeds it the recorded
    inputs in lockstep, and compares each output with the recorded one: byte for byte, or within a
    tolerance. Shows the first divergent step with its inputs. Uses the program of the scenario in
    --source, or else the copy in the recording. Exit code 0: equal, 10: different. A recorded
    program that differs from yours starts only with --trust.

    $ stepbus replay run.mcap --participant controller
    $ stepbus replay runs/arm --participant controller --set controller.params.kp=9
    $ stepbus replay runs/arm --participant controller --abs 1e-9 --exec ./mine
    $ stepbus replay run.mcap --participant controller --update new.mcap
    """

    recording: Recording
    _: KW_ONLY
    participant: Annotated[str, Parameter(metavar="NAME")]
    """participant to start"""
    tolerances: Annotated[Tolerances, FLAT] = Tolerances()
    set: Settings = ()
    """override one value of the recorded scenario, e.g. controller.params.kp=101"""
    update: Annotated[Path | None, Parameter(metavar="OUT.mcap")] = None
    """write a new reference recording"""
    window: Count = 256
    """number of steps that recorded inputs are sent ahead"""
    recorded: Annotated[bool, EITHER] = False
    """start the copy in the recording, not the program of the scenario"""
    source: Annotated[Folder, EITHER] = None
    """folder or file of the scenario (default: the file that result.json names, or else the current
    folder)"""
    bridge: BridgeFormat = None
    program: Annotated[
        Texts | None,
        Parameter(
            name="--exec", consume_multiple=True, allow_leading_hyphen=True, metavar="PROGRAM ..."
        ),
    ] = None
    """start this program instead of the recorded one, in the current folder; all following
    arguments belong to it"""
    trust: Trust = False
    json: Json = False


class Play(Command, work="play", group="test", is_run=True):
    """Play a recording slowly to one participant that you start yourself.

    Waits for a participant that you start with `stepbus join TICKET`, in a debugger for example,
    and publishes the recorded messages of all others to it, at a rate of your choice. Shows its
    outputs, beside the recorded ones where they differ: `value | recorded (difference)`. It has no
    deadlines. In a terminal, p pauses and resumes, s makes one step, q stops. Exit code 0: equal,
    10: different.

    $ stepbus play runs/arm --participant controller --rate 0.2
    $ stepbus play runs/arm --participant controller --from 3s --to 5s
    """

    recording: Recording
    _: KW_ONLY
    participant: Annotated[str, Parameter(metavar="NAME")]
    """participant that you start"""
    rate: Annotated[_Factor, Parameter(metavar="FACTOR")] = 1.0
    """steps by the wall clock, at FACTOR times real time"""
    begin: Annotated[str, Parameter(name="--from", metavar="STEP")] = "0"
    """pace and show from this step on, or time such as 3s; before it, as fast as possible"""
    end: Annotated[str, Parameter(name="--to", metavar="STEP")] = ""
    """end before this step, or time"""
    ticket: File = None
    """where its ticket is put (default: NAME.ticket in the current folder)"""
    tolerances: Annotated[Tolerances, FLAT] = Tolerances()
    set: Set = ()
    source: Folder = None
    """folder or file of the scenario, as in replay"""
    trust: Trust = False


class Rerun(Command, work="repeat", group="test", is_run=True):
    """Repeat a run from its recording alone.

    Extracts the scenario and its files from a recording into <out>/source, runs it, and compares
    the new recording with the old one, byte for byte. Lists what differs on this machine, such as
    versions. Exit code 0: all messages are equal, 10: at least one differs. A recording contains
    programs: those that are not in your scenario's folder start only with --trust.

    $ stepbus rerun runs/two_link-20250101-120000/run.mcap
    $ stepbus rerun run.mcap --set window=1 --out /tmp/again
    $ stepbus rerun sweeps/two_link 17
    """

    recording: Path
    """a run.mcap, the folder of its run, or the folder of a sweep"""
    row: Index | None = None
    """number of a run in a sweep"""
    _: KW_ONLY
    out: NewRun = None
    set: Set = ()
    trust: Trust = False
    json: Json = False


class Verify(Command, work="compare", group="test", is_run=True):
    """Run a scenario several times and compare the recordings.

    Runs a scenario several times: once unchanged, then with shuffled start orders, random delays in
    every participant, and different windows and transports, and finally, if possible, with all
    participants in one process. All recordings must be byte-identical. Exit code 10: two differ;
    the first difference is shown.

    $ stepbus verify two_link
    $ stepbus verify two_link -n 10 --set duration=2s --seed 1
    """

    scenario: Scenario
    _: KW_ONLY
    runs: Annotated[int, Parameter(name="-n", metavar="RUNS", validator=Number(gte=2))] = 5
    """number of runs in separate processes"""
    seed: Index = 0
    """seed of the start orders and delays"""
    out: Folder = None
    """keep the runs in this new folder"""
    set: Set = ()
    json: Json = False


class Diff(Command, work="compare", group="test"):
    """Compare two recordings, port by port.

    Compares the messages of two recordings byte for byte, or within a tolerance. The recordings may
    differ in length or be truncated. Shows the first difference first. PORT is a topic such as
    controller/command. Exit code 0: equal, 10: different.

    $ stepbus diff runs/a/run.mcap runs/b/run.mcap
    $ stepbus diff a.mcap b.mcap --abs controller/command.values=1e-9
    $ stepbus diff a.mcap b.mcap --tolerance tolerance.yaml --json
    $ stepbus diff runs/a runs/b --code
    """

    first: Recording
    second: Recording
    _: KW_ONLY
    tolerances: Annotated[Tolerances, FLAT] = Tolerances()
    code: bool = False
    """show how the recorded scenarios and their files differ, as a unified diff"""
    json: Json = False


class Branch(Command, work="repeat", group="test", is_run=True):
    """Replay a recording up to a step, then run live with your changes.

    Replays a recording up to a step, then continues as a live run with your changes. Until that
    step, every participant gets its recorded inputs as fast as it can process them and must publish
    the recorded outputs; the first one that diverges is reported (exit code 10). Without a change,
    the new recording is byte-identical to the old one. A changed participant also gets its recorded
    inputs; its own outputs are used from that step on. A recording contains programs: those that
    are not in your scenario's folder start only with --trust.

    $ stepbus branch run.mcap --at 1200
    $ stepbus branch run.mcap --at 6s --set controller.params.kp=90
    $ stepbus branch run.mcap --at 1200 --vary controller.params.kp=50,100,200
    $ stepbus branch run.mcap --at 1200 --fault 'freeze plant at 1300 for 200ms'
    $ stepbus branch run.mcap --at 1200 --debug controller
    """

    recording: Recording
    _: KW_ONLY
    at: Annotated[str, Parameter(metavar="STEP")]
    """the first live step, or its time, e.g. 6s"""
    out: NewRun = None
    set: Settings = ()
    """change a parameter from that step on, e.g. controller.params.kp=90; may be repeated"""
    calls: Annotated[Texts, Parameter(name="--call", metavar="CALL")] = ()
    """call a participant before that step, e.g. 'controller set kp 90'; may be repeated"""
    faults: Faults = ()
    """inject a fault at that step or later, e.g. 'freeze plant at 1300 for 200ms'"""
    in_process: bool = False
    """run all participants in one process: faster, same recording"""
    no_checkpoints: bool = False
    """replay from step 0, without the saved checkpoints"""
    vary: Annotated[Texts, Parameter(metavar="PATH=VALUE,VALUE")] = ()
    """make one branch per value, and one picture of all branches; may be repeated"""
    plot: Annotated[Texts, Parameter(metavar="SIGNAL")] = ()
    """signal in that picture, as in `stepbus plot`; default: the joint errors"""
    debug: Names = ()
    """run a participant in this terminal without deadlines, for a debugger"""
    no_report: NoReport = False
    json: Json = False
    trust: Trust = False


class Join(Command, work="attach", group="attach"):
    """Start a participant of a run from another terminal, container or debugger.

    Waits for the run of a ticket, then runs the program in this terminal, with the arguments and
    environment that the run would have used (including the bridge). The run must expect it:
    `stepbus run --external NAME`, or `start: external` in the scenario. You can start either one
    first (docs/guide/running/attach.md). Exits with the program's exit code.

    $ stepbus join runs/two_link-20260101-120000/controller.ticket
    $ stepbus join /tmp/c.ticket -- python my_controller.py
    $ stepbus join --wait 10min /tmp/c.ticket -- python -m pdb my_controller.py
    """

    ticket: Path
    """the ticket: its path, which the run prints, or the line that it prints with `--external
    NAME=-`"""
    program: Texts = ()
    """command line of the program, after `--`; default: the one in the scenario"""
    _: KW_ONLY
    wait: Duration = "60s"
    """how long to wait for the run"""


class Bridge(Command, work="attach", group="attach"):
    """Connect a program to a run through the bridge.

    Joins a run with the ticket in STEPBUS_TICKET, starts a program, and exchanges every step with
    it over file descriptors 3 and 4 (docs/guide/writing/bridge.md). A scenario starts it with the
    key `bridge`, or explicitly: `exec: [stepbus, bridge, --format, json, --, node,
    controller.mjs]`.

    $ stepbus bridge --format json -- node controller.mjs
    $ stepbus bridge --format raw -- octave-cli --quiet controller.m
    """

    program: Texts
    """command line of the program, after `--`"""
    _: KW_ONLY
    format: Literal["json", "msgpack", "raw"] = "json"
    """format of the messages"""
    describe: Annotated[str, Parameter(metavar="JSON")] = "{}"
    """descriptions of the outputs, e.g. {"command": {"like": "joint_state"}}"""


class Call(Command, work="attach", group="attach"):
    """Call a method of a participant in a live run.

    Calls a method of a participant in a live run, from a second terminal. The participant answers
    between two steps. A call that only reads does not affect the result. A call that changes the
    run is recorded with its step; rerun, replay and branch repeat it at that step.

    $ stepbus call runs/arm
    $ stepbus call runs/arm plant joint_position joint1
    $ stepbus call runs/arm plant set_joint_position joint1 0.5
    $ stepbus call runs/arm mission set_target joint1 30deg 0.5
    $ stepbus call runs/arm controller set kp 90
    $ stepbus call runs/arm run pause
    """

    run: Path
    """folder of a live run"""
    participant: str = ""
    """participant to call, or `run` for the run itself; without it, lists all methods"""
    method: str = ""
    """method to call"""
    args: Texts = ()
    """arguments, as YAML values"""
    _: KW_ONLY
    json: Json = False


class Help(Command, work="app"):
    """Show the help of a command.

    Shows what a command does, its options and examples. Without a command, lists all commands.

    $ stepbus help run
    """

    command: str = ""
    """a command"""


class Completion(Command, work="app"):
    """Print the completion script of a shell.

    Completes commands, options, names of scenarios and files. The script lists the commands that
    are installed when you print it. To try it in bash: `source <(stepbus completion bash)`. See
    docs/reference/cli.md for where each shell keeps it.

    $ stepbus completion bash
    $ stepbus completion zsh
    $ stepbus completion fish
    """

    shell: Literal["bash", "zsh", "fish"]
    """shell"""
