"""The commands of the tools."""

import contextlib
from dataclasses import KW_ONLY
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from stepbus_orchestrator.cli.options import (
    BridgeFormat,
    Command,
    Count,
    Duration,
    File,
    Folder,
    Index,
    Json,
    Port,
    Recording,
    Scenario,
    Set,
    Settings,
    Texts,
    scenarios,
)


class Export(Command, work="recordings", group="look"):
    """Export a recording to other formats.

    Writes a recording as tables (CSV, Parquet), a video, a 3D scene in one HTML file, or a file for
    ROS 2, Foxglove or Rerun. A damaged recording is exported up to the damage. Exit code 8: a port
    could not be exported completely.

    $ stepbus export run.mcap --parquet tables
    $ stepbus export runs/arm --csv all.csv
    $ stepbus export runs/arm --video arm.mp4 --viewpoint front --size 1280x720
    $ stepbus export runs/arm --video arm.gif --from 2s --to 5s
    $ stepbus export runs/arm --ros2 arm.mcap
    $ stepbus export run.mcap --scene scene.html
    """

    recording: Recording
    _: KW_ONLY

    @classmethod
    def complete(cls) -> type[Command]:
        """Return the class with the options of all installed exporters."""
        exporters = import_module("stepbus_tools.exporters").exporters()
        rows: list[tuple[str, Any, str, str]] = []
        rows += [(name, Path, one.metavar, one.help) for name, one in exporters.items()]
        for form, one in exporters.items():
            for name, (value, text) in one.options.items():
                rows.append((name, str, value, f"with --{form}: {text}"))
        for name, kind, metavar, text in rows:
            parameter = Parameter(metavar=metavar, help=text)
            cls.__annotations__[name] = Annotated[kind | None, parameter]
            setattr(cls, name, None)
        return super().complete()


class Plot(Command, work="recordings", group="look"):
    """Plot signals of a recording.

    Draws signals of a recording over simulation time, one panel each, in one picture. A port alone
    selects all its numbers. Without a signal, lists all signals of the recording.

    $ stepbus plot run.mcap controller.command plant.joint_state.position[0]
    $ stepbus plot runs/arm plant.joint_state.velocity[joint2] --out velocity.svg
    """

    recording: Recording
    signals: Annotated[Texts, Parameter(metavar="SIGNAL")] = ()
    """PARTICIPANT.PORT, with .FIELD, with [INDEX] or [JOINT] (none: list all signals)"""
    _: KW_ONLY
    out: File = None
    """the picture: .png, .svg or .pdf (default: plot.png next to the recording)"""


class Report(Command, work="recordings", group="look"):
    """Write report.html for a run, or compare several runs.

    Writes one self-contained HTML file: outcome and reason, curves of the joints and of every other
    numeric port, the animated 3D scene, events and faults, step times, camera stills. Several
    recordings share their charts. `stepbus run` writes this report for each run, without the
    animated scene.

    $ stepbus report runs/arm
    $ stepbus report runs/pd runs/pid --out comparison.html
    """

    recordings: Annotated[tuple[Path, ...], Parameter(metavar="RECORDING")]
    """a run.mcap, or the folder of its run; several are compared"""
    _: KW_ONLY
    out: File = None
    """the page (default: report.html next to the first recording)"""
    no_replay: bool = False
    """omit the animated scene, which takes some seconds to write and needs the extra `view`"""


class View(Command, work="view", group="look"):
    """Show a recording or a live run in 3D, in the browser.

    Serves a local page with the robot and world of a recording: targets as ghosts, contacts,
    planned paths, detections, camera images, curves and events, with a time slider. It reads only
    what you look at, so a long recording opens immediately. The URL contains a
    token.

    $ stepbus view runs/arm
    $ stepbus view runs/arm/run.mcap runs/other/run.mcap --no-open
    """

    recording: Path
    """a run.mcap, or the folder of its run, which may be live"""
    ghost: Path | None = None
    """a second recording, drawn as a ghost"""
    _: KW_ONLY
    follow: bool = False
    """wait for a run to start in this folder"""
    until_end: bool = False
    """exit when the run ends, instead of showing its recording"""
    port: Port | None = None
    """port to listen on (default: any free port)"""
    host: str = "127.0.0.1"
    """address to listen on (default: this machine only)"""
    no_open: bool = False
    """do not open a browser"""


class Conformance(Command, work="checks", group="test", is_run=True):
    """Check a program against the protocol.

    Simulates the orchestrator and all peers of one participant, on the real bus, and checks the
    participant's behaviour: 65 checks, each of one clause of docs/protocol.md. Restarts the program
    for each check. Exit code 0: no check failed, 11: at least one failed.

    $ stepbus conformance -- ./my_controller
    $ stepbus conformance --bridge json -- node controller.mjs
    $ stepbus conformance --only windows --only determinism -- ./my_controller
    $ stepbus conformance --scenario my/scenario.yaml --participant plant
    $ stepbus conformance --list
    """

    program: Annotated[Texts, Parameter(metavar="-- PROGRAM")] = ()
    """command line of the program, started in the current folder (default: the one in the
    scenario)"""
    _: KW_ONLY
    bridge: BridgeFormat = None
    scenario: Annotated[str, Parameter(completer=scenarios)] = "two_link"
    """scenario that defines the ports"""
    participant: Annotated[str, Parameter(metavar="NAME")] = "controller"
    """participant that the program implements"""
    set: Settings = ()
    """override one value of the scenario, e.g. controller.step_timeout=10s"""
    only: Annotated[Texts, Parameter(metavar="NAME")] = ()
    """run this check; may be repeated"""
    list: bool = False
    """list the checks and start nothing"""
    logs: Folder = None
    """keep the program's logs"""
    junit: File = None
    """write JUnit XML"""
    json: Json = False


class Doctor(Command, work="checks", group="test"):
    """Check this machine: versions, bus, extras; or other hosts.

    Checks versions, native libraries, the bus (with a message) and missing extras. Exit code 1:
    something is broken.

    With --hosts, checks other hosts instead, before a run needs them: whether SSH reaches each,
    whether it has the same stepbus, and whether it reaches this host.

    $ stepbus doctor
    $ stepbus doctor --hosts hosts.yaml --listen 192.0.2.7:7447
    """

    _: KW_ONLY
    hosts: File = None
    """the hosts, as for `stepbus run` (docs/guide/running/hosts.md)"""
    listen: Annotated[str, Parameter(metavar="ADDRESS[:PORT]")] = ""
    """where the run is to listen (default: as the first host was reached, any free port)"""
    json: Json = False


class Selftest(Command, work="checks", group="test", is_run=True):
    """Move every joint to a known angle and read it back.

    Runs the plant of a scenario without its controller and mission. Moves one joint at a time to
    90° and to -90°, or as far as its limits allow, and checks that this joint moves, in the
    commanded direction, by the commanded angle, within its limits, and that no other joint moves. A
    joint passes if it reaches one side: on the other side the robot may collide with itself. Joints
    in torque mode are pushed forward and back, then set to the angle. Exit code 0: every joint
    passes, 11: at least one fails; otherwise those of `stepbus run`.

    $ stepbus selftest two_link
    $ stepbus selftest baxter --angle 30
    $ stepbus selftest two_link --json
    """

    scenario: Scenario
    _: KW_ONLY
    set: Set = ()
    angle: Annotated[float, Parameter(metavar="DEGREES")] = 90
    """target angle, limited by the range of each joint"""
    json: Json = False


_Whole = int | str | None
"""An integer; any other text is reported with all other problems of the sweep."""


class Sweep(Command, work="sweep", group="many", is_run=True):
    """Run a scenario many times with different values, and collect one table.

    Runs a scenario once for each combination of the values that you vary, on all cores or on a Ray
    cluster, and writes one row per run to results.parquet: the values, the outcome, metrics, and
    the SHA-256 of the recording. Run the same command again to resume an interrupted sweep. A
    failed run is a row too; the exit code is 0 once every run has its row.

    $ stepbus sweep two_link --vary controller.params.kp=50:200:7
    $ stepbus sweep two_link --samples 9 --vary 'controller.params.kp~normal(9, 1)'
    $ stepbus sweep two_link --vary controller.params.kp=10:400:log --optimize rmse
    $ stepbus sweep my_sweep.yaml --out sweeps/friction --keep all
    """

    scenario: Annotated[str, Parameter(completer=scenarios)]
    """a scenario, as of `stepbus run`, or the YAML file of a sweep
    (docs/guide/running/sweeps.md)"""
    _: KW_ONLY
    vary: Annotated[Texts, Parameter(metavar="AXIS")] = ()
    """PATH=50:200:7, PATH=1:1000:4:log, PATH=a,b,c, 'PATH~normal(1, 0.1)', 'PATH=1,2 & PATH=3,4'
    (together), 'faults=none,kill plant at 100'; may be repeated"""
    set: Settings = ()
    """override one value in all runs, e.g. duration=2s; may be repeated"""
    samples: _Whole = None
    """number of samples from each distribution (~)"""
    sampling: str | None = None
    """sampling method: random, latin, sobol or halton"""
    seed: _Whole = None
    """seed of the samples and the optimizer"""
    repeats: _Whole = None
    """runs per point, each with another seed"""
    metrics: Annotated[Texts, Parameter(name="--metric", metavar="FILE.py:FUNCTION")] = ()
    """your own metric, a function of the recording; may be repeated"""
    optimize: Annotated[str | None, Parameter(metavar="METRIC")] = None
    """minimize this metric with Optuna, which chooses the points; axes: PATH=50:200[:log]"""
    maximize: bool = False
    """maximize the metric instead"""
    trials: _Whole = None
    """number of runs for --optimize"""
    batch: _Whole = None
    """number of runs that the optimizer proposes at once (default: 4)"""
    out: Folder = None
    """folder of the sweep (default: one in sweeps/)"""
    jobs: Count | None = None
    """number of worker processes (default: all cores)"""
    keep: Literal["all", "failed", "none"] = "failed"
    """recordings to keep"""
    timeout: Duration = ""
    """time limit of a run, e.g. 90s (default: none)"""
    retry: Annotated[Index, Parameter(metavar="N")] = 0
    """how often to repeat a run that failed to start, died or timed out"""
    address: str = ""
    """address of a Ray cluster, e.g. auto or HOST:6379"""
    json: Json = False

    def load(self) -> Any:
        """Start what loads on another core meanwhile, and return the function."""
        server = import_module("stepbus_tools.sweep.server_process")
        with contextlib.suppress(OSError):
            if not self.address:
                server.early.append(server.start_server())
        return super().load()
