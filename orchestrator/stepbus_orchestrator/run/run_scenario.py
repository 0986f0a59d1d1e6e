"""Runs a scenario: the one function behind `stepbus run`, free of global state."""

import dataclasses
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.errors import RecordingFailed, RunFailure
from stepbus_orchestrator.plugins import HOSTS, named_points
from stepbus_orchestrator.processes.launcher import check_limits
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.run.extension import Host, RunExtension, overriding
from stepbus_orchestrator.run.extensions import with_defaults
from stepbus_orchestrator.run.files import RunFiles
from stepbus_orchestrator.run.folder import default_folder
from stepbus_orchestrator.run.hosts import Elsewhere, InProcess, Processes
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.result import Result, file_sha256, own_versions
from stepbus_orchestrator.run.run import Run
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.program import check_installed


@dataclasses.dataclass(frozen=True, kw_only=True)
class Options:
    """How to run, as opposed to what.

    out: folder of the run's files; made, must be empty; default: `runs/<scenario>-<time>`. host:
    where it takes place; default: each participant in a process of its own. is_recorded: whether
    the run writes run.mcap, timing.mcap and result.json. extensions: features of the run, beside
    those that every run has.
    """

    out: Path | None = None
    host: Host = dataclasses.field(default_factory=Processes)
    is_recorded: bool = True
    extensions: Sequence[RunExtension] = ()


def host_of(
    *,
    in_process: bool,
    owns_descriptors: bool = False,
    is_star: bool = False,
    elsewhere: Elsewhere | None = None,
) -> Host:
    """Return the host of a run; the others: as of `InProcess` and `Processes`."""
    if in_process:
        return InProcess(owns_descriptors=owns_descriptors, is_star=is_star)
    return Processes(is_star=is_star, elsewhere=elsewhere or Elsewhere())


def reaching(
    scenario: Scenario, hosts: Path | None, listen: str
) -> tuple[Elsewhere, list[RunExtension]]:
    """Return what takes a run to other hosts, and the extensions that it needs.

    hosts: file that says where they are. listen: address and port for them. Raises WiringError for
    a file or an address that is none.
    """
    if hosts is None and not listen:
        return Elsewhere(), []
    elsewhere, extension = named_points(HOSTS)["ssh"].load()(scenario, hosts, listen)
    return elsewhere, [extension]


def run(
    scenario: Scenario,
    options: Options,
    observer: Observer | None = None,
    interrupt: threading.Event | None = None,
) -> Result:
    """Run a scenario and return how it ended; result.json has the same.

    observer: is notified of progress. interrupt: ends the run when it is set, e.g. by Ctrl-C.
    A run that fails returns its failure. Raises RecordingFailed when there is no folder to write
    to, StartFailed when it may not open enough files, ExtraMissing where a package that one of our
    participants needs is not installed, WiringError where the host cannot run this scenario, or an
    extension cannot do its work in it.
    """
    extensions = with_defaults(scenario, options.extensions, is_recorded=options.is_recorded)
    for extension in extensions:
        scenario = extension.prepare(scenario)
    if overriding(extensions, "completed"):
        scenario = dataclasses.replace(scenario, window=1, batch=1)
    check_installed(scenario)
    check_limits(len(scenario.participants))
    options.host.check(scenario)
    adapted = scenario
    for extension in extensions:
        adapted = extension.adapt(adapted)
    observer = observer or Observer()
    # Not before: a run that cannot start leaves no folder.
    folder = options.out or default_folder(scenario, Path("runs"))
    files = RunFiles(scenario, folder, options.host, observer, is_recorded=options.is_recorded)
    this = Run(
        adapted,
        files.recorder,
        files.timing,
        out=files.out,
        observer=observer,
        interrupt=interrupt,
        extensions=extensions,
        warn=files.events.add_warning,
        result=lambda: msgspec.json.encode(_result(this, files)),
    )
    ending: str | RunFailure = ""
    try:
        ending = _ending(this, files, options.host)
    finally:
        ending = files.close(ending, is_finished=this.is_recorded, steps=this.state.steps)
    result = _result(this, files, ending)
    if options.is_recorded:
        files.save(result, extensions)
    return result


def _ending(run: Run, files: RunFiles, host: Host) -> str | RunFailure:
    """Run, and return why it ended, or what it failed from."""
    try:
        files.describe()
        return run.take_place(host)
    except RunFailure as exc:
        return exc
    except OSError as exc:
        # It was not expected of any file.
        kind = RecordingFailed if str(exc.filename).startswith(str(files.out)) else RunFailure
        return kind(f"{exc.filename or 'this machine'}: {exc.strerror or exc}")
    except MemoryError:
        return RunFailure("the orchestrator has no memory left; raise its limit (ulimit -v)")


def _result(run: Run, files: RunFiles, ending: str | RunFailure = "") -> Result:
    """Return the result of a run; without an ending, what it would be were the run over now.

    ending: why it ended, or what it failed from.
    """
    fields: dict[str, Any] = {}
    for extension in run.extensions if run.is_attached else ():
        fields |= extension.result()
    failure = ending if isinstance(ending, RunFailure) else None
    scenario, state, folder = files.scenario, run.state, files.folder
    started, participants = state.started_at, state.participants.values()
    wall_s = run.ended_at - started if started else 0.0
    simulated_s = state.steps * scenario.step_ns * 1e-9
    cause = str(ending)
    for part in (part for one in participants for part in one.local()):
        cause = cause.replace(part, "")
    return Result(
        scenario=scenario.name,
        outcome="finished" if failure is None else "failed",
        exit_code=0 if failure is None else int(failure.code),
        reason=str(ending),
        cause=cause.replace(str(folder), "."),
        participant=failure.participant if failure else None,
        at_step=failure.step if failure else state.steps,
        steps=state.steps,
        step_ns=scenario.step_ns,
        seed=scenario.seed,
        window=scenario.window,
        transport=scenario.bus.transport,
        start_s=started - files.opened_at if started else 0.0,
        wall_s=wall_s,
        real_time_factor=simulated_s / wall_s if wall_s else 0.0,
        sha256=file_sha256(folder / layout.RUN_FILE),
        messages_sha256=files.recorder.messages_sha256,
        folder=str(folder),
        unauthenticated=state.unauthenticated,
        drops={item.name: sum(item.drops.values()) for item in participants},
        warning_count=files.events.count,
        warnings=files.events.warnings,
        versions=own_versions(),
        file=str(scenario.file),
        overrides=scenario.overrides,
        **fields,
    )
