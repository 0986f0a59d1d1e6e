"""`stepbus export-fmu`: asks a short run what the ports hold, and packs the scenario."""

import dataclasses
import hashlib
import keyword
import re
import shutil
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec

from stepbus_fmi.declared import ExportFmu
from stepbus_orchestrator.cli.interrupts import interruptible
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.errors import OutputExists
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.sources import Sources
from stepbus_orchestrator.run.folder import read_files, scratch_folder
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.resolve import resolved
from stepbus_participant import need
from stepbus_schemas import Decoder, Message, WiringError, error_text, suggest

from .interface import Interface, parameter_rows, port_rows
from .play import One
from .slave import FILE

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
    with scratch_folder("export-fmu") as folder, interruptible() as interrupt:
        longest = [
            max((s.every, *(i.delay for i in s.inputs.values()))) for s in scenario.participants
        ]
        steps = 1 + sum(longest)
        short = dataclasses.replace(scenario, steps=min(steps, scenario.steps or steps), faults=())
        run(short, Options(out=folder / "run"), interrupt=interrupt).check()
        recording, source, lost = Recording(folder / "run"), folder / "source", list[str]()
        interface = _interface(given, scenario, recording, lost)
        source.mkdir()
        sources = Sources(resolved(scenario).encode(), read_files(scenario.files))
        path = sources.unpack(source / "scenario").relative_to(source)
        interface = msgspec.structs.replace(interface, scenario=str(path))
        if interface.participant and (why := _stateless(scenario, interface, recording)):
            lost.append(f"its state: {why}")
        elif interface.participant:
            interface = msgspec.structs.replace(interface, has_state=True)
        _build(given, library, source, interface)
    variables = [row.causality for row in interface.rows for _ in row.start]
    counts = [f"{variables.count(side)} {side}s" for side in ("input", "output", "parameter")]
    text = f"{given.out}: FMI {given.fmi}.0, {', '.join(counts)}"
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
            known = f"; it has {', '.join(names)}"
            raise WiringError(
                f"{scenario.name} has no participant {name!r}{suggest(name, names)}{known}"
            )
    if given.participant and not scenario.participant(given.participant).participant:
        raise WiringError(
            f"{given.participant} is a program of its own; only a class becomes an FMU"
        )


def _interface(
    given: ExportFmu, scenario: Scenario, recording: Recording, lost: list[str]
) -> Interface:
    one = given.participant
    rows = []
    for spec in scenario.participants:
        prefix = () if one else (spec.name,)
        if one in {"", spec.name} and spec.name != given.input:
            rows += parameter_rows(spec, scenario.folder, prefix)
        sides = []
        if spec.name == one:
            sides += [("input", port, (i.source, i.port)) for port, i in spec.inputs.items()]
        if one in {"", spec.name}:
            side = "input" if spec.name == given.input else "output"
            sides += [(side, port, (spec.name, port)) for port in spec.outputs]
        for side, name, source in sides:
            if scenario.participant(source[0]).outputs[source[1]].bulk:
                lost.append(f"{spec.name}.{name}: a bulk port")
                continue
            port = recording.ports["/".join(source)]
            own = {"causality": side, "owner": spec.name, "prefix": prefix, "port": name}
            rows += port_rows(port, lost, **own)
    names = [name for row in rows for name, _ in row.variables()]
    if twice := next((name for name in names if names.count(name) > 1), ""):
        raise WiringError(f"two variables would be named {twice}; rename a port of {one}")
    what = f"{one} of the scenario {scenario.name}" if one else f"the scenario {scenario.name}"
    topics = dict[str, str]()
    if one:
        ports = scenario.participant(one).inputs.items()
        topics = {port: f"{item.source}/{item.port}" for port, item in ports}
    elif given.input:
        topics = {p: f"{given.input}/{p}" for p in scenario.participant(given.input).outputs}
    described = {
        port: msgspec.structs.replace(
            recording.ports[topic].description, names=list(recording.ports[topic].names), like=None
        )
        for port, topic in topics.items()
    }
    return Interface(
        scenario="",
        text=f"{what}; needs a Python with stepbus, as `stepbus export-fmu` says",
        step_ns=scenario.step_ns,
        duration_s=None if scenario.steps is None else scenario.steps * scenario.step_ns * 1e-9,
        participant=one,
        played=given.input,
        described=described,
        rows=rows,
    )


def _stateless(scenario: Scenario, interface: Interface, recording: Recording) -> str:
    """Return why the state of a participant cannot be saved; empty where it can.

    It is tried with recorded messages: one that goes on and one that is restored answer equally.
    """
    name, messages = interface.participant, dict[tuple[str, str], Message]()
    for port, item in scenario.participant(name).inputs.items():
        source = recording.ports[f"{item.source}/{item.port}"]
        for entry in source.entries():
            messages[name, port] = Decoder(source.message_class)(entry.data)
    try:
        with (
            closing(One(scenario, name, interface.described)) as first,
            closing(One(scenario, name, interface.described)) as second,
        ):
            first.step(0, messages)
            saved, held = first.save()
            if saved is None:
                return "its class does not save it"
            second.restore(saved, held)
            for one in (first, second):
                one.outputs.clear()
                for index in range(1, 2 * first.config.every + 1):
                    one.step(index, messages)
            is_same = (first.outputs, first.save()) == (second.outputs, second.save())
            return "" if is_same else "one that is restored goes another way"
    except Exception as exc:  # noqa: BLE001  whatever its class raises
        return error_text(exc)


def _build(given: ExportFmu, library: Any, source: Path, interface: Interface) -> None:
    """Let the library make the FMU of a folder of sources."""
    content = msgspec.json.encode(interface)
    (source / FILE).write_bytes(content)
    name = re.sub(r"\W", "_", given.out.stem)
    if not name.isidentifier() or keyword.iskeyword(name):
        name = f"fmu_{name}"
    # In one process, two modules of a name would be one.
    script = source / f"{name}_{hashlib.sha256(content).hexdigest()[:12]}.py"
    script.write_text(_SLAVE.format(library=library.__name__, fmi=given.fmi, name=name))
    state = {
        f"can{verb}FMU{'S' if given.fmi == '3' else 's'}tate": interface.has_state
        for verb in ("GetAndSet", "Serialize")
    }
    path = list(sys.path)
    try:
        built = library.FmuBuilder.build_FMU(
            script,
            dest=source / "built",
            project_files=[source / FILE, source / "scenario"],
            canHandleVariableCommunicationStepSize=False,
            **state,
        )
    finally:
        sys.path[:] = path
    given.out.parent.mkdir(parents=True, exist_ok=True)
    shutil.move(built, given.out)
