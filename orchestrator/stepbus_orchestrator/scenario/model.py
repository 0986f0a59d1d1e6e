"""A scenario as frozen types. Durations are integers [ns]; deadlines, of the wall clock, [s].

What stands in a file as it is here is declared as `Settings`; `declaration.py` has the rest.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from stepbus_participant import Duration, Settings
from stepbus_participant.parameters import Pause
from stepbus_schemas import SHIPPED, BridgeFormat, Types

LAST_TCP_PORT = 65535
Publishes = Literal["first", "last"]
Transport = Literal["unix", "tcp"]
Start = Literal["child", "external"]
OnLate = Literal["count", "fail"]


@dataclass(frozen=True, kw_only=True)
class InputSpec:
    """Where an input comes from: output `port` of participant `source`, `delay` steps old.

    type: the message type the participant expects, where the scenario says it.
    """

    source: str
    port: str
    delay: int = 0
    type: str | None = None


class OutputSpec(Settings):
    """What an output carries."""

    short = "type"

    type: str
    """`Name/major`, one of [messages.md](messages.md) or of the scenario's `types`."""
    bulk: bool = False
    """Large content, which travels on a key of its own."""


class HoldSpec(Settings):
    """What is published instead of a participant that has failed."""

    hold_ns: Duration = 500_000_000
    """How long the safe messages are published, after `keep`."""
    keep_ns: Pause = 20_000_000
    """How long its last messages are repeated; may be `0s`."""
    safe: dict[str, dict[str, Any]] = msgspec.field(default_factory=dict)
    """Output → message, where it is not the default of the output's type."""


class BridgeSpec(Settings):
    """How a program takes part that does not speak Zenoh."""

    short = "format"

    format: BridgeFormat
    """What the program reads and writes."""
    describe: dict[str, dict[str, Any]] = msgspec.field(default_factory=dict)
    """Output → its description, where it is not the default."""


class BusSpec(Settings):
    """How participants reach each other. Changes no result."""

    transport: Transport = "unix"
    """Unix sockets in a private folder, or TCP on loopback."""
    port: Annotated[int, msgspec.Meta(ge=1, le=LAST_TCP_PORT)] | None = None
    """First TCP port: the orchestrator has it, the participants have those after it; only with
    `tcp`. Default: any free ones."""
    low_latency: bool | None = None
    """Zenoh's low-latency transport: faster, but it loses messages over 64 KiB; never
    over TCP. Default: the orchestrator chooses."""


@dataclass(frozen=True, kw_only=True)
class Deadlines:
    """How long a participant may take for each phase, by the wall clock [s]."""

    spawn_s: float = 20.0
    join_s: float = 10.0
    ready_s: float = 30.0
    step_s: float = 3.0
    stop_s: float = 3.0


EXTERNAL_SPAWN_S = 120.0
"""Deadline of a participant that somebody starts by hand: until its process is on the bus [s]."""


@dataclass(frozen=True, kw_only=True)
class FaultSpec:
    """A fault on purpose: its type, participant and step; duration_ns: for how long [ns]."""

    type: str
    participant: str
    step: int
    duration_ns: int | None = None


@dataclass(frozen=True, kw_only=True)
class ParticipantSpec:
    """One participant.

    participant: the class that it is, `file.py:Class` or `module:Class`; or else exec: the command
    as written in the scenario; `program.command` makes it one that can be run.
    every: it fires at multiples of this [steps]. publishes: whether it publishes before or after
    it reads its inputs. on_fault: how the run continues when it fails; None: it ends. bridge: how
    the program is reached where it does not speak Zenoh itself. files: patterns of files that it
    loads and that nothing names. start: whether the orchestrator starts it, or somebody else does
    with its ticket; changes no result. real_time, on_late: whether it has to keep time in a run in
    real time, and what happens if it does not.
    """

    name: str
    participant: str = ""
    exec: tuple[str, ...] = ()
    every: int = 1
    publishes: Publishes = "last"
    inputs: Mapping[str, InputSpec] = field(default_factory=dict)
    outputs: Mapping[str, OutputSpec] = field(default_factory=dict)
    params: Mapping[str, Any] = field(default_factory=dict)
    deadlines: Deadlines = Deadlines()
    on_fault: HoldSpec | None = None
    bridge: BridgeSpec | None = None
    files: tuple[str, ...] = ()
    start: Start = "child"
    real_time: bool = False
    on_late: OnLate = "count"

    @property
    def program(self) -> tuple[str, ...]:
        """Return its command as `exec` would have it."""
        return self.exec or ("python", "-m", "stepbus_participant", self.participant)

    @property
    def is_external(self) -> bool:
        """Return whether somebody else starts it."""
        return self.start == "external"


@dataclass(frozen=True, kw_only=True, repr=False)
class Scenario:
    """A complete scenario, checked.

    step_ns: length of a communication step [ns]. steps: how many; none: until something ends the
    run. participants: in the order of the file. window: steps that may be in flight. batch:
    outputs of a participant per log message. checkpoint_steps: how often participants save their
    state, 0: never. faults: what is done to it on purpose. types: message
    types, with its own that ports have. type_files: files of the scenario → the types that each
    declares. folder: what relative file names are relative to. file: where it was read from.
    overrides: with which. files: what a recording of it holds, name → file; left_out: what it does
    not, a sentence each. Two scenarios are equal when all before `folder` is.
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
        """Return one participant; raises KeyError when there is none of that name."""
        return {spec.name: spec for spec in self.participants}[name]

    def __repr__(self) -> str:
        """Return its name, its steps and its participants, in a line."""
        count = "" if self.steps is None else f"{self.steps} "
        who = ", ".join(spec.name for spec in self.participants)
        return f"<Scenario {self.name}: {count}steps of {self.step_ns * 1e-6:g} ms, {who}>"


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
