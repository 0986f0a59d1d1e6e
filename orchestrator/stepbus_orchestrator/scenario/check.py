"""Checks what no part of a scenario shows by itself: connections, programs, parameters.

Parameters are those of the class `Params` (`stepbus.Settings`) in the module, or file, that
`participant` names; nothing is started.
"""

import json
import subprocess
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial

from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.ports import InputSpec
from stepbus_orchestrator.scenario.program import PYTHON, check_program
from stepbus_orchestrator.scenario.schedule import sort
from stepbus_participant import Problems, declared_parameters, extra_hint, is_ours, suggest
from stepbus_participant.parameters import Keys, find_problems
from stepbus_schemas import raw_problem

_LONGEST_S = 30.0


def check(scenario: Scenario, problems: Problems) -> None:
    """Add to `problems` all that cannot work although each part is well formed."""
    specs = {spec.name: spec for spec in scenario.participants}
    for spec in scenario.participants:
        keys: Keys = ("participants", spec.name)
        _add(problems, keys, _mistakes(spec, specs, scenario))
        program = (*keys, "participant" if spec.participant else "exec")
        is_given = bool(spec.participant or spec.exec) and not problems.has(program)
        # Others need not be on this machine.
        if is_given and spec.is_here:
            problems.attempt(program, partial(check_program, spec, scenario.folder))
    _check_loops(scenario, specs, problems)
    _check_params(scenario, problems)


def _add(problems: Problems, keys: Keys, mistakes: Iterable[tuple[Keys, str]]) -> None:
    for below, message in mistakes:
        problems.add((*keys, *below), message)


def _mistakes(
    spec: ParticipantSpec, specs: Mapping[str, ParticipantSpec], scenario: Scenario
) -> Iterator[tuple[Keys, str]]:
    """Yield why a participant cannot be connected, held or bridged: keys below it, and a text."""
    for port, item in spec.inputs.items():
        if mistake := _connection_mistake(spec, item, specs):
            yield ("inputs", port), mistake
    if spec.hold is not None and (mistake := _holding_mistake(spec)):
        yield ("on_fault",), mistake
    if spec.bridge is not None and spec.bridge.format == "raw":
        outputs = {port: output.type for port, output in spec.outputs.items()}
        inputs = {
            port: specs[item.source].outputs[item.port].type
            for port, item in spec.inputs.items()
            if item.source in specs and item.port in specs[item.source].outputs
        }
        if mistake := raw_problem(spec.publishes, inputs, outputs, scenario.types):
            yield ("bridge",), mistake


def _connection_mistake(
    spec: ParticipantSpec, item: InputSpec, specs: Mapping[str, ParticipantSpec]
) -> str:
    """Return why an input cannot be connected, or nothing."""
    source = specs.get(item.source)
    if source is None:
        others = [name for name in specs if name != spec.name]
        return f"no participant {item.source!r}{suggest(item.source, others)}"
    if source is spec:
        return (
            f"{spec.name!r} reads its own output; keep that value as a variable of the "
            "participant instead"
        )
    output = source.outputs.get(item.port)
    if output is None:
        return f"{item.source!r} has no output {item.port!r}{suggest(item.port, source.outputs)}"
    if item.type is not None and output.type and item.type != output.type:
        return (
            f"expects {item.type}, but {item.source}.{item.port} is {output.type} "
            f"(participants.{item.source}.outputs.{item.port})"
        )
    return ""


def _holding_mistake(spec: ParticipantSpec) -> str:
    """Return why no other can stand in for a participant, or nothing."""
    if spec.publishes == "first":
        return "hold is not possible for a participant that publishes first"
    if not spec.outputs:
        return "hold needs an output"
    bulk = [port for port, output in spec.outputs.items() if output.bulk]
    return f"hold cannot publish the bulk output {bulk[0]!r}" if bulk else ""


def _check_loops(
    scenario: Scenario, specs: Mapping[str, ParticipantSpec], problems: Problems
) -> None:
    for loop in sort(scenario.participants)[1]:
        source, reader = loop[0], loop[1]
        inputs = specs[reader].inputs.items() if source != reader else ()
        for port in (p for p, i in inputs if i.source == source and i.delay == 0):
            problems.add(
                ("participants", reader, "inputs", port),
                f"algebraic loop {' → '.join(loop)}: each waits for another's output of the same "
                "step; give one of these inputs `delay: 1`, or set `publishes: first` for one that "
                "publishes its state before it reads its inputs, as a plant does",
            )


def _check_params(scenario: Scenario, problems: Problems) -> None:
    """Add what is wrong with the parameters of participants.

    Modules of ours are imported here: with their parameters, they load nothing heavy. All others
    are the user's, and imported where they have parameters.
    """
    others = []
    for spec in scenario.participants:
        keys: Keys = ("participants", spec.name)
        source = spec.participant.rpartition(":")[0]
        if not source or any(problems.has((*keys, key)) for key in ("participant", "params")):
            continue
        if not is_ours(source):
            others.append(spec)
            continue
        try:
            declared = declared_parameters(source, scenario.folder)
        except ModuleNotFoundError as exc:
            text = f"{source} needs {exc.name}, which is not installed"
            problems.add(keys, text + extra_hint(exc.name or ""))
            continue
        if declared is not None:
            _add(problems, (*keys, "params"), find_problems(declared, spec.params, scenario.folder))
    _check_classes(scenario, [spec for spec in others if spec.params], problems)


def _check_classes(
    scenario: Scenario, specs: Sequence[ParticipantSpec], problems: Problems
) -> None:
    """Import the classes of participants, in a process of its own, and add what is wrong.

    Code of the user's may never return, or end its process: it does neither to ours.
    """
    if not specs:
        return
    requests = [{"participant": s.participant, "params": dict(s.params)} for s in specs]
    try:
        done = subprocess.run(
            [*PYTHON, "-m", "stepbus_participant", "--check"],
            input=json.dumps(requests),
            capture_output=True,
            text=True,
            cwd=scenario.folder,
            timeout=_LONGEST_S,
            check=True,
            start_new_session=True,
        )
        answers = json.loads(done.stdout)
    except (OSError, subprocess.SubprocessError, ValueError) as exc:
        why = str(exc)
        if isinstance(exc, subprocess.CalledProcessError):
            why = f"its process ends with exit code {exc.returncode}"
        for spec in specs:
            text = f"{spec.participant} cannot be checked: {why}"
            problems.add(("participants", spec.name, "participant"), text)
        return
    for spec, answer in zip(specs, answers, strict=True):
        _add(problems, ("participants", spec.name), [(tuple(k), text) for k, text in answer])
