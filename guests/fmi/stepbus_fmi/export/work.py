"""`stepbus export-fmu`: asks a short run what the ports hold, and packs the scenario."""

import dataclasses
import hashlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import msgspec

from stepbus_fmi.declared import ExportFmu
from stepbus_orchestrator.cli.interrupts import interruptible
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.errors import OutputExists
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.sources import Sources
from stepbus_orchestrator.run.folder import read_files, scratch_folder
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.ports import InputSpec
from stepbus_orchestrator.scenario.resolve import resolved
from stepbus_participant import make_folder, need, replaced
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import WiringError, suggest

from .interface import Interface, Played, Row, parameter_rows, port_rows
from .slave import FILE, Importer

_SLAVE = """import {library}
from stepbus_fmi.export.slave import KEPT, Exported

KEPT.append(globals())


class {name}(Exported, {library}.Fmi{fmi}Slave):
    library = {library}
"""


def exportfmu_command(given: ExportFmu) -> Answer:
    """Write the FMU, and say what it has and what it leaves out."""
    (library,) = need("stepbus export-fmu", "pythonfmu3" if given.fmi == "3" else "pythonfmu")
    scenario = load(given.scenario, given.set)
    _check(given, scenario)
    steps = sum(s.every + sum(i.delay for i in s.inputs.values()) for s in scenario.participants)
    short = dataclasses.replace(scenario, steps=min(steps, scenario.steps or steps), faults=())
    with scratch_folder("export-fmu") as folder, interruptible() as interrupt:
        run(short, Options(out=folder / "run"), interrupt=interrupt).check()
        recording, source, lost = Recording(folder / "run"), folder / "source", list[str]()
        rows, played = _ports(given, scenario, recording, lost)
        inside, importer = _with_importer(given, scenario, played, rows)
        InProcess(instead="an FMU has all in one process").check(inside)
        sources = Sources(resolved(inside).encode(), read_files(inside.files))
        path = sources.unpack(source / "scenario").relative_to(source)
        interface = Interface(
            scenario=str(path),
            text=f"{given.participant or 'all'} of {scenario.name}; needs a Python with stepbus",
            step_ns=scenario.step_ns,
            duration_s=scenario.steps and scenario.steps * scenario.step_ns * 1e-9,
            importer=importer,
            played=played,
            rows=rows,
        )
        _build(given, library, source, msgspec.json.encode(interface))
    text = f"{given.out}: FMI {given.fmi}.0, {sum(len(row.start) for row in rows)} variables"
    return Answer(value=None, lines=[text, *(f"left out: {line}" for line in lost)])


def _check(given: ExportFmu, scenario: Scenario) -> None:
    """Raise WiringError for what cannot become this FMU."""
    if given.out.suffix != ".fmu":
        raise WiringError(f"--out {given.out}: the name of an FMU ends in .fmu")
    if given.out.exists():
        raise OutputExists(f"{given.out} already exists; choose another --out")
    if given.participant and given.input:
        raise WiringError("--input is for a whole scenario; leave out the participant, or --input")
    names = [spec.name for spec in scenario.participants]
    for name in filter(None, (given.participant, given.input)):
        if name not in names:
            raise WiringError(f"no participant {name!r} in {scenario.name}{suggest(name, names)}")


def _ports(
    given: ExportFmu, scenario: Scenario, recording: Recording, lost: list[str]
) -> tuple[list[Row], dict[str, Played]]:
    """Return the rows of the FMU, and the ports that its importer plays."""
    rows, played, one = list[Row](), dict[str, Played](), given.participant
    for spec in scenario.participants if not one else [scenario.participant(one)]:
        prefix, is_played = "" if one else spec.name, spec.name == given.input
        rows += () if is_played else parameter_rows(spec, scenario.folder, prefix)
        side, inputs = "input" if is_played else "output", spec.inputs.items() if one else ()
        ports = [("input", port, i.source, i.port, i.delay, spec.every) for port, i in inputs]
        ports += [(side, port, spec.name, port, 0, 1) for port in spec.outputs]
        for causality, port, source, output, delay, reads in ports:
            if scenario.participant(source).outputs[output].bulk:
                lost.append(f"{spec.name}.{port}: a bulk port")
                continue
            recorded = recording.ports[f"{source}/{output}"]
            rows += port_rows(recorded, prefix, lost, (causality, spec.name, port))
            if causality == "input":
                named, every = list(recorded.names), scenario.participant(source).every
                text = msgspec.structs.replace(recorded.description, names=named, like=None)
                played[port] = Played(recorded.type, text, every, delay, reads)
    if given.fmi == "3":
        rows.append(Row("independent", "", "", "time", "Real", [("time", "")], [0.0], (), "s"))
    return rows, played


def _with_importer(
    given: ExportFmu, scenario: Scenario, played: Mapping[str, Played], rows: list[Row]
) -> tuple[Scenario, str]:
    """Return the scenario in which the importer takes part, and its name there.

    It reads all outputs of the FMU; those that need its message of the same step, a step later.
    """
    content = parse_yaml("scenario", resolved(dataclasses.replace(scenario, faults=())))
    people, one = content["participants"], given.participant
    importer = given.input or next(n for n in ("importer", "fmu", "host") if n not in people)
    if one:
        people = {one: people[one] | {"inputs": {port: f"{importer}.{port}" for port in played}}}
    outputs = {port: item.type for port, item in played.items()}
    name = f"{Importer.__module__}:{Importer.__name__}"
    people[importer] = {"participant": name, "outputs": outputs}
    inside = load({**content, "participants": people}, folder=scenario.folder)

    def is_late(name: str) -> bool:
        spec = inside.participant(name)
        sources = [item.source for item in spec.inputs.values() if item.delay == 0]
        return name == importer or (spec.publishes != "first" and any(map(is_late, sources)))

    shown = sorted({(row.owner, row.port) for row in rows if row.causality == "output"})
    inputs = {
        f"i{number}": InputSpec(from_=f"{name}.{port}", delay=int(is_late(name)))
        for number, (name, port) in enumerate(shown)
    }
    return inside.changed([importer], inputs=inputs), importer


def _build(given: ExportFmu, library: Any, source: Path, content: bytes) -> None:
    """Let the library make the FMU of a folder of sources; content: the interface."""
    (source / FILE).write_bytes(content)
    name = re.sub(r"\W", "_", f"fmu_{given.out.stem}")
    # In one process, two modules of a name would be one.
    script = source / f"{name}_{hashlib.sha256(content).hexdigest()[:12]}.py"
    script.write_text(_SLAVE.format(library=library.__name__, fmi=given.fmi, name=name))
    built = library.FmuBuilder.build_FMU(
        script,
        dest=source / "built",
        project_files=[source / FILE, source / "scenario"],
        canHandleVariableCommunicationStepSize=False,
    )
    try:
        make_folder(given.out.parent)
        with replaced(given.out) as part, ZipFile(built) as old, ZipFile(part, "w") as new:
            # The same bytes each time: without times, in the order of names.
            for info in sorted(old.infolist(), key=lambda info: info.filename):
                data, info.date_time = old.read(info), (1980, 1, 1, 0, 0, 0)
                info.external_attr = 0o644 << 16
                new.writestr(info, data, ZIP_DEFLATED)
    except OSError as exc:
        raise WiringError(f"{given.out} cannot be written: {exc.strerror or exc}") from exc
