"""A scenario's plain data as frozen types: kinds, names, durations and numbers are checked here."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import msgspec

from stepbus_orchestrator.bridge.formats import FORMATS
from stepbus_participant.durations import LONGEST_NS, format_duration
from stepbus_schemas import Description, WiringError, message_class

from .faults import Setting, parse_fault
from .fields import Field
from .model import (
    BridgeSpec,
    BusSpec,
    Deadlines,
    FaultSpec,
    HoldSpec,
    InputSpec,
    OutputSpec,
    ParticipantSpec,
    Publishes,
    Scenario,
    Transport,
)
from .override import TOP_KEYS
from .problems import hint, show

_PHASES = ("spawn", "join", "ready", "step", "stop")
PARTICIPANT_KEYS = (
    "exec",
    "every",
    "publishes",
    "inputs",
    "outputs",
    "params",
    *(f"{phase}_timeout" for phase in _PHASES),
    "on_fault",
    "bridge",
)
_RESERVED = ("orchestrator", *TOP_KEYS)
_LAST_PORT = 65535


def build(root: Field, file: Path) -> Scenario:
    """Return the scenario that the root of a document stands for.

    Problems are noted in `root.problems`; values that are wrong are then replaced by defaults.
    """
    root.check_keys(TOP_KEYS, required=("name", "step", "participants"))
    step_ns = root["step"].duration_ns()
    participants = tuple(_participant(item, step_ns) for item in root["participants"].children())
    if root["participants"].value == {}:
        root["participants"].wrong("is empty; a scenario needs at least one participant")
    window = root["window"].integer(64, least=1)
    steps = _steps(root["duration"], step_ns)
    seed = root["seed"].integer(0)
    return Scenario(
        name=root["name"].title(),
        step_ns=step_ns or 1,
        steps=steps,
        seed=seed,
        participants=participants,
        bus=_bus(root["bus"], len(participants)),
        window=window,
        batch=_batch(root["batch"], window),
        faults=_faults(root["faults"], Setting(participants, steps, seed)),
        folder=file.parent,
        file=file,
    )


def _steps(duration: Field, step_ns: int | None) -> int | None:
    duration_ns = duration.duration_ns()
    if duration_ns is None or step_ns is None:
        return None
    steps, rest = divmod(duration_ns, step_ns)
    if rest:
        near = [n * step_ns for n in (steps, steps + 1) if 0 < n * step_ns <= LONGEST_NS]
        duration.wrong(
            f"{duration.value} is {duration_ns / step_ns:.6g} steps of {format_duration(step_ns)}, "
            f"not a whole number; the nearest is {' or '.join(map(format_duration, near))}"
        )
    return steps


def _batch(field: Field, window: int) -> int:
    most = max(1, window // 2)
    batch = field.integer(most, least=1)
    if batch > most:
        field.wrong(f"must be at most half the window ({window}), that is {most}, not {batch}")
    return batch


def _bus(field: Field, participants: int) -> BusSpec:
    field.check_keys(("transport", "port", "low_latency"))
    choice = field["transport"].choice(("unix", "tcp"))
    transport = choice or "unix"
    if field["transport"].value in (None, "unix") and not field["port"].absent:
        field["port"].wrong("is for transport tcp; a Unix socket has none")
    last = _LAST_PORT - participants
    port = field["port"].integer(0, least=1, most=last) or None
    low_latency = field["low_latency"].boolean()
    return BusSpec(transport=cast("Transport", transport), port=port, low_latency=low_latency)


def _faults(field: Field, setting: Setting) -> tuple[FaultSpec, ...]:
    found: list[FaultSpec] = []
    for item in field.items():
        if not isinstance(item.value, str):
            item.wrong(f"must be text, e.g. kill plant at 120, not {show(item.value)}")
            continue
        try:
            found += parse_fault(item.text(), setting)
        except WiringError as exc:
            item.wrong(str(exc))
    return tuple(found)


def _participant(field: Field, step_ns: int | None) -> ParticipantSpec:
    field.check_name()
    if field.name in _RESERVED:
        field.wrong(f"{field.name!r} means something else already; choose another name")
    if field.absent:
        field.wrong("is empty; it needs at least exec")
    else:
        field.check_keys(PARTICIPANT_KEYS, required=("exec",))
    for name in (port for key in ("inputs", "outputs") for port in field[key].children()):
        name.check_name()
    every = field["every"].integer(1, least=1, most=LONGEST_NS // (step_ns or 1))
    publishes = field["publishes"]
    # A misspelt `first` must not show as an algebraic loop too.
    order = publishes.choice(("first", "last")) or ("last" if publishes.absent else "first")
    field["params"].check_keys(tuple(field["params"].value or ()))
    return ParticipantSpec(
        name=field.name,
        exec=_exec(field["exec"]),
        every=every,
        publishes=cast("Publishes", order),
        inputs={item.name: spec for item in field["inputs"].children() if (spec := _input(item))},
        outputs={item.name: _output(item) for item in field["outputs"].children()},
        params=field["params"].value if isinstance(field["params"].value, dict) else {},
        deadlines=_deadlines(field),
        on_fault=_on_fault(field["on_fault"], field),
        bridge=_bridge(field["bridge"], field),
    )


def _on_fault(field: Field, participant: Field) -> HoldSpec | None:
    """Return `on_fault: hold`, or `{hold: 500ms, keep: 20ms, safe: {port: message}}`."""
    if not isinstance(field.value, dict):
        return HoldSpec() if field.choice(("stop", "hold")) == "hold" else None
    field.check_keys(("hold", "keep", "safe"))
    outputs = participant["outputs"].value
    known = outputs if isinstance(outputs, dict) else {}
    safe = {item.name: _safe(item, known) for item in field["safe"].children()}
    default = HoldSpec()
    return HoldSpec(
        keep_ns=_keep_ns(field["keep"], default.keep_ns),
        hold_ns=field["hold"].duration_ns() or default.hold_ns,
        safe=safe,
    )


def _keep_ns(field: Field, default: int) -> int:
    """Return a duration that, other than most, may be `0s`."""
    if field.value in ("0s", "0ms"):
        return 0
    given = field.duration_ns()
    return default if given is None else given


def _safe(field: Field, outputs: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a message for a port; noted when it is not of the port's type."""
    declared = outputs.get(field.name)
    if declared is None:
        field.wrong(f"no output {field.name!r}{hint(field.name, outputs)}")
        return {}
    type_name = declared.get("type") if isinstance(declared, dict) else declared
    try:
        msgspec.convert(field.value, message_class(str(type_name)))
    except (WiringError, msgspec.ValidationError) as exc:
        field.wrong(f"is no {type_name}: {exc}")
        return {}
    return cast("Mapping[str, Any]", field.value)


def _bridge(field: Field, participant: Field) -> BridgeSpec | None:
    """Return `bridge: json`, or `bridge: {format: json, describe: {port: description}}`."""
    if isinstance(field.value, dict):
        field.check_keys(("format", "describe"), required=("format",))
    if isinstance(field.value, list):
        field.wrong("must be a format, e.g. json, or {format: json, describe: {…}}")
        return None
    form = (field["format"] if isinstance(field.value, dict) else field).choice(FORMATS)
    outputs = participant["outputs"].value
    known = outputs if isinstance(outputs, dict) else {}
    describe = {item.name: _description(item, known) for item in field["describe"].children()}
    return None if form is None else BridgeSpec(format=form, describe=describe)


def _description(field: Field, outputs: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the description of an output; noted when it is none."""
    if field.name not in outputs:
        field.wrong(f"no output {field.name!r}{hint(field.name, outputs)}")
    if not isinstance(field.value, dict):
        field.wrong("must be a description, e.g. {names: [joint1, joint2]} or {like: joint_state}")
        return {}
    field.check_keys(Description.__struct_fields__)
    try:
        msgspec.convert(field.value, Description)
    except msgspec.ValidationError as exc:
        field.wrong(str(exc))
        return {}
    return cast("Mapping[str, Any]", field.value)


def _exec(field: Field) -> tuple[str, ...]:
    words = field.texts()
    if field.value == [] or words[:1] == ("",):
        field.wrong("names no program")
        return ()
    return words


def _input(field: Field) -> InputSpec | None:
    """Return `port: plant.joint_state`, or `port: {from: plant.joint_state, delay: 1}`."""
    if isinstance(field.value, dict):
        field.check_keys(("from", "delay", "type"), required=("from",))
    origin = field["from"] if isinstance(field.value, dict) else field
    source, dot, port = origin.text().partition(".")
    if not (source and dot and port) or "." in port:
        if field.absent or (isinstance(origin.value, str)):
            origin.wrong(
                f"must be PARTICIPANT.OUTPUT, e.g. plant.joint_state, not {origin.text()!r}"
            )
        return None
    type_name = _message_type(field["type"]) or None
    return InputSpec(source=source, port=port, delay=field["delay"].integer(0), type=type_name)


def _output(field: Field) -> OutputSpec:
    """Return `port: Image/1`, or `port: {type: Image/1, bulk: true}`."""
    if isinstance(field.value, dict):
        field.check_keys(("type", "bulk"), required=("type",))
        bulk = field["bulk"].boolean() or False
        return OutputSpec(type=_message_type(field["type"]), bulk=bulk)
    if field.absent:
        field.wrong("needs a message type, e.g. JointState/1")
    return OutputSpec(type=_message_type(field))


def _message_type(field: Field) -> str:
    """Return the name of a message type; nothing when it is absent or wrong."""
    name = field.text()
    if name:
        try:
            message_class(name)
        except WiringError as exc:
            field.wrong(str(exc))
            return ""
    return name


def _deadlines(field: Field) -> Deadlines:
    given = {f"{phase}_s": field[f"{phase}_timeout"].duration_ns() for phase in _PHASES}
    seconds = {name: value / 1e9 for name, value in given.items() if value is not None}
    return dataclasses.replace(Deadlines(), **seconds)
