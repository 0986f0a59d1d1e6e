"""A scenario: every key of its file, declared once, and what a run has of it.

From here come reading, the tables of docs/reference/scenario.md and the JSON Schema for editors.
Durations are integers [ns]; deadlines, of the wall clock, [s].
"""

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import structs

from stepbus_participant import Count, Duration, Name, Settings, Whole, suggest
from stepbus_participant.parameters import Keys, Pause
from stepbus_schemas import SHIPPED, BridgeFormat, Description, Types, explained

from .ports import InputSpec, OutputSpec

LAST_TCP_PORT = 65535
EXTERNAL_SPAWN_S = 120.0
"""Deadline of a participant that the user starts by hand: until its process is on the bus [s]."""
Transport = Literal["unix", "tcp"]


class HoldSpec(Settings):
    """What is published instead of a participant that has failed."""

    hold_ns: Duration = 500_000_000
    """How long the safe messages are published, after `keep`."""
    keep_ns: Pause = 20_000_000
    """How long its last messages are repeated; may be `0s`."""
    safe: dict[str, dict[str, Any]] = {}
    """Output → message, where it is not the default of the output's type."""


class BridgeSpec(Settings, omit_defaults=True):
    """How a program takes part that does not speak Zenoh."""

    short = "format"

    format: BridgeFormat
    """What the program reads and writes."""
    describe: dict[str, dict[str, Any]] = {}
    """Output → its description, where it is not the default."""


class BusSpec(Settings):
    """How participants connect to each other. Changes no result."""

    transport: Transport = "unix"
    """Unix sockets in a private folder, or TCP on loopback."""
    port: Annotated[int, msgspec.Meta(ge=1, le=LAST_TCP_PORT)] | None = None
    """First TCP port: the orchestrator uses it, the participants use the ports after it; only with
    `tcp`. Default: any free ports."""
    low_latency: bool | None = None
    """Zenoh's low-latency transport: faster, but it loses messages over 64 KiB; never
    over TCP. Default: the orchestrator chooses."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield a port for Unix sockets."""
        if self.port is not None and self.transport == "unix":
            yield ("port",), "is only for transport tcp; Unix sockets have no port"


@dataclass(frozen=True, kw_only=True)
class Deadlines:
    """How long a participant may take for each phase, by the wall clock [s]."""

    spawn_s: float = 20.0
    join_s: float = 10.0
    ready_s: float = 30.0
    step_s: float = 3.0
    stop_s: float = 3.0


class ParticipantRow(Settings, dict=True):
    """A participant."""

    participant: str = ""
    """Its Python class: `my_controller.py:Controller` in a file next to the scenario,
    `my_arm.controller:Controller` in a module; or an FMU, `motor.fmu`. For other programs, `exec`
    ([participant](#participant))."""
    exec: tuple[str, ...] = ()
    """Command that starts it, for a program in any language ([exec](#exec))."""
    every: Count = 1
    """It fires at steps 0, `every`, 2 · `every` …"""
    publishes: Literal["first", "last"] = "last"
    """Whether it publishes before it reads its inputs (a plant: its state) or after (a controller).
    """
    inputs: dict[Name, InputSpec] = {}
    """Port → the output that it reads ([inputs](#inputs))."""
    outputs: dict[Name, OutputSpec] = {}
    """Port → the message type that it publishes ([outputs](#outputs))."""
    params: dict[str, Any] = {}
    """Parameters of the participant; checked where it declares them
    ([parameters.md](parameters.md))."""
    start: Literal["child", "external"] = "child"
    """Who starts it: the orchestrator, or you, with `stepbus join`
    ([attach.md](../guide/running/attach.md)). Changes no result."""
    host: Name | Literal[""] = ""
    """Name of the host on which it runs; `--hosts` says where that is
    ([hosts.md](../guide/running/hosts.md)). Changes no result. Default: this one."""
    real_time: bool = False
    """Whether it has to keep time in a run in real time
    ([real_time.md](../guide/running/real_time.md)). Changes no result."""
    on_late: Literal["count", "fail"] = "count"
    """Whether the run counts its late steps, or fails at the first; with `real_time`."""
    spawn_timeout_ns: Duration | None = None
    """Time until its process is on the bus. Default: 20s, with `start: external` 2min."""
    join_timeout_ns: Duration = round(Deadlines.join_s * 1e9)
    """Time from there until it has joined."""
    ready_timeout_ns: Duration = round(Deadlines.ready_s * 1e9)
    """Time from there until its model is loaded and it is connected to its sources."""
    step_timeout_ns: Duration = round(Deadlines.step_s * 1e9)
    """How long it may hold a step."""
    stop_timeout_ns: Duration = round(Deadlines.stop_s * 1e9)
    """Time from the request to stop until it has left the run and, if it is a class, ended."""
    on_fault: Literal["stop", "hold"] | HoldSpec = "stop"
    """What happens when it fails: the run ends, or the orchestrator first brings everything to rest
    ([faults.md](../faults.md))."""
    bridge: BridgeSpec | None = None
    """`exec` is a program in any language that reads descriptor 3 and writes descriptor 4
    ([bridge.md](../guide/writing/bridge.md))."""

    files: tuple[str, ...] = ()
    """Files that it loads in addition to [those that are recorded anyway](#files): patterns and
    folders, such as `[build/, "../data/*.csv"]`, so that a run can be repeated from its
    recording."""

    @property
    def program(self) -> tuple[str, ...]:
        """Return the command that starts it, as `exec` would have it: its own, or its bridge's."""
        if self.bridge is None:
            return self.exec or ("python", "-m", "stepbus_participant", self.participant)
        described = self.bridge.describe
        describe = ("--describe", json.dumps(described)) if described else ()
        return ("stepbus", "bridge", "--format", self.bridge.format, *describe, "--", *self.exec)

    @property
    def is_external(self) -> bool:
        """Return whether the user starts it."""
        return self.start == "external"

    @property
    def is_here(self) -> bool:
        """Return whether the orchestrator starts it on this host."""
        return self.start == "child" and not self.host

    @property
    def hold(self) -> HoldSpec | None:
        """Return how the run continues when it fails; None: it ends."""
        if isinstance(self.on_fault, HoldSpec):
            return self.on_fault
        return HoldSpec() if self.on_fault == "hold" else None

    @cached_property
    def deadlines(self) -> Deadlines:
        """Return how long it may take."""
        spawn_s = Deadlines.spawn_s if self.start == "child" else EXTERNAL_SPAWN_S
        return Deadlines(
            spawn_s=self.spawn_timeout_ns / 1e9 if self.spawn_timeout_ns else spawn_s,
            join_s=self.join_timeout_ns / 1e9,
            ready_s=self.ready_timeout_ns / 1e9,
            step_s=self.step_timeout_ns / 1e9,
            stop_s=self.stop_timeout_ns / 1e9,
        )

    @classmethod
    def elsewhere(cls, key: str) -> str:
        """Return where a key belongs that is none of a participant's."""
        if key == "external":
            return "a participant that you start yourself has `start: external`"
        if key == "name":
            return "the participant's name is its key under `participants`"
        if key in keys_of(ScenarioFile):
            return (
                f"{key!r} belongs to the scenario: write it at the top level, next to "
                "`participants`"
            )
        parts = (("inputs", InputSpec), ("on_fault", HoldSpec), ("bridge", BridgeSpec))
        for part, settings in parts:
            if key in keys_of(settings):
                return f"{key!r} belongs to `{part}`"
        is_near = "did you mean" in suggest(key, keys_of(cls))
        return "" if is_near else f"if the participant itself reads it, write it as params.{key}"

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong with the command, and with descriptions of outputs."""
        if self.participant:
            yield from self._class_problems(self.participant)
        elif not self.exec:
            yield (), "needs either 'participant', a class, or 'exec', the command of a program"
        elif not self.exec[0]:
            yield ("exec",), "needs the name of a program"
        if self.host and self.is_external:
            yield ("host",), "is for a participant that stepbus starts there; omit it, or `start`"
        if self.on_late == "fail" and not self.real_time:
            yield ("on_late",), "applies only with real_time true"
        for index, word in enumerate(self.exec):
            if "\0" in word:
                yield ("exec", index), "must not contain a null character"
        if self.bridge is not None:
            yield from self._describe_problems(self.bridge.describe)

    def _class_problems(self, name: str) -> Iterator[tuple[Keys, str]]:
        given = {"exec": self.exec, "bridge": self.bridge}
        for key in (key for key, value in given.items() if value):
            text = (
                f"is only for a program (`exec`), but {name} is a class (`participant`); "
                "remove one of them"
            )
            yield (key,), text
        source, _, attribute = name.rpartition(":")
        if not source or not attribute.isidentifier():
            text = "must be FILE.py:CLASS or MODULE:CLASS, e.g. controller.py:Controller"
            yield ("participant",), f"{text}, not {name!r}"

    def _describe_problems(self, describe: Mapping[str, Any]) -> Iterator[tuple[Keys, str]]:
        for port, description in describe.items():
            keys = ("bridge", "describe", port)
            if port not in self.outputs:
                yield keys, f"no output {port!r}{suggest(port, self.outputs)}"
            for at, text in message_problems(description, Description, "Description"):
                yield (*keys, *at), text


def message_problems(
    data: Mapping[str, Any], cls: type[msgspec.Struct], name: str
) -> Iterator[tuple[Keys, str]]:
    """Yield all reasons why plain data is no message of a class. name: of the class."""
    known = cls.__struct_fields__
    for key in (key for key in data if key not in known):
        yield (key,), f"{name} has no field {key!r}{suggest(key, known)}"
    try:
        msgspec.convert(data, cls)
    except msgspec.ValidationError as exc:
        yield (), f"is not a valid {name}: {explained(exc, cls)}"


class ParticipantSpec(ParticipantRow):
    """A participant of a scenario, with its name.

    folder: base of its relative file names; empty: that of the scenario.
    """

    name: str
    folder: str = ""


@dataclass(frozen=True, kw_only=True)
class FaultSpec:
    """A fault on purpose: its type, participant and step; duration_ns: for how long [ns]."""

    type: str
    participant: str
    step: int
    duration_ns: int | None = None


class ScenarioFile(Settings):
    """A scenario."""

    name: Name
    """Names the folder of the recording."""
    step_ns: Duration
    """Length of a communication step; simulation time is step number × this."""
    duration_ns: Duration | None = None
    """A whole number of steps; without it the run lasts until a participant or you end it."""
    seed: Whole = 0
    """Every participant derives its own seed from this and its name."""
    faults: tuple[str, ...] = ()
    """Injected faults: `kill plant at 120`, `random 3` ([faults.md](../faults.md))."""
    participants: dict[Name, ParticipantRow]
    """Name → participant, at least one. If several could be first within a step, this order
    decides."""
    window: Count = 64
    """Steps in flight; 1: no participant starts a step before all have finished the previous one.
    Changes no result."""
    batch: Count | None = None
    """Number of outputs of a participant in one message to the recording; at most half the window.
    Changes no result. Default: half the window."""
    checkpoint_ns: Duration | None = None
    """How often participants save their state, in whole steps, so that a branch need not start at
    step 0 ([branch.md](../guide/testing/branch.md#checkpoints)). Changes no result. Default:
    never."""
    bus: BusSpec = BusSpec()
    """How participants connect to each other. Changes no result."""
    types: str | dict[str, Any] | tuple[str | dict[str, Any], ...] = {}
    """Your own message types: declared here, in YAML files, or as classes in installed Python
    modules; also a list of these ([message_types.md](../guide/writing/message_types.md))."""
    extends: str | None = None
    """Scenario that this one extends: a file or folder, or one that ships
    ([extends](#one-scenario-on-top-of-another))."""

    @classmethod
    def elsewhere(cls, key: str) -> str:
        """Return where a key belongs that is none of a scenario's."""
        if key == "external":
            return "a participant that you start yourself has `start: external`"
        if key in keys_of(BusSpec):
            return f"{key!r} belongs to `bus`"
        if key in keys_of(ParticipantRow):
            return f"{key!r} belongs to a participant: participants.NAME.{key}"
        return ""


def keys_of(settings: type[Settings]) -> tuple[str, ...]:
    """Return the keys of a map."""
    return settings.__struct_encode_fields__


@dataclass(frozen=True, kw_only=True, repr=False)
class Scenario:
    """A complete scenario, checked.

    step_ns: length of a communication step [ns]. steps: number of steps; None: no fixed end.
    participants: in the order of the file. window: maximum steps in flight. batch: outputs of a
    participant per log message. checkpoint_steps: steps between two saved states of a participant,
    0: never. faults: faults to inject. types: message types, including the scenario's own.
    type_files: files of the scenario → the types that each declares. folder: base of relative file
    names. file: path of the scenario file. overrides: overridden values. files: files that a
    recording contains, name → file; left_out: a text for each file that it does not contain. Two
    scenarios are equal when all fields before `folder` are.
    """

    name: str
    step_ns: int
    steps: int | None
    seed: int
    participants: tuple[ParticipantSpec, ...]
    bus: BusSpec = field(default_factory=BusSpec)
    window: int = 64
    batch: int = 32
    checkpoint_steps: int = 0
    faults: tuple[FaultSpec, ...] = ()
    types: Types = SHIPPED
    type_files: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    folder: Path = field(compare=False)
    file: Path = field(compare=False)
    overrides: tuple[str, ...] = field(default=(), compare=False)
    files: Mapping[str, Path] = field(default_factory=dict, compare=False)
    left_out: Sequence[str] = field(default=(), compare=False)

    def participant(self, name: str) -> ParticipantSpec:
        """Return a participant by name; raises KeyError for an unknown name."""
        return {spec.name: spec for spec in self.participants}[name]

    def changed(self, names: Collection[str], **fields: Any) -> "Scenario":
        """Return a copy of the scenario with changed fields of some participants."""
        rows = self.participants
        specs = (structs.replace(row, **fields) if row.name in names else row for row in rows)
        return replace(self, participants=tuple(specs))

    def __repr__(self) -> str:
        """Return its name, its steps and its participants, in a line."""
        count = "" if self.steps is None else f"{self.steps} "
        who = ", ".join(spec.name for spec in self.participants)
        return f"<Scenario {self.name}: {count}steps of {self.step_ns * 1e-6:g} ms, {who}>"


def partly_recorded(specs: Iterable[ParticipantSpec]) -> dict[str, dict[str, int]]:
    """Return participant → output that is not recorded whole → every how many steps; 0: never."""
    every = {
        spec.name: {
            port: output.record_every * spec.every
            for port, output in spec.outputs.items()
            if output.record_every != 1
        }
        for spec in specs
    }
    return {name: ports for name, ports in every.items() if ports}


def low_latency(scenario: Scenario) -> bool:
    """Return whether to use Zenoh's low-latency transport.

    It silently loses messages over 64 KiB, so scenarios with bulk ports do not use it; over TLS,
    it loses those over 48 KiB, which a log may have, so TCP never uses it.
    """
    if scenario.bus.transport == "tcp":
        return False
    if scenario.bus.low_latency is not None:
        return scenario.bus.low_latency
    specs = scenario.participants
    return not any(output.bulk for spec in specs for output in spec.outputs.values())
