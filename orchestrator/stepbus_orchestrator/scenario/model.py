"""A scenario as frozen types. Durations are integers [ns]; deadlines, of the wall clock, [s]."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

Publishes = Literal["first", "last"]
Transport = Literal["unix", "tcp"]


@dataclass(frozen=True, kw_only=True)
class InputSpec:
    """Where an input comes from: output `port` of participant `source`, `delay` steps old.

    type: the message type the participant expects, where the scenario says it.
    """

    source: str
    port: str
    delay: int = 0
    type: str | None = None


@dataclass(frozen=True, kw_only=True)
class OutputSpec:
    """What an output carries: a message type, `Name/major`; bulk: on a key of its own."""

    type: str
    bulk: bool = False


@dataclass(frozen=True, kw_only=True)
class Deadlines:
    """How long a participant may take for each phase, by the wall clock [s]."""

    spawn_s: float = 20.0
    join_s: float = 10.0
    ready_s: float = 30.0
    step_s: float = 3.0
    stop_s: float = 3.0


@dataclass(frozen=True, kw_only=True)
class HoldSpec:
    """What is published instead of a participant that has failed.

    keep_ns: for how long its last messages [ns]. hold_ns: for how long after that the safe ones
    [ns]. safe: port → message, where it is not the default of the port's type.
    """

    keep_ns: int = 20_000_000
    hold_ns: int = 500_000_000
    safe: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class BridgeSpec:
    """How a program takes part that does not speak Zenoh (docs/guide/bridge.md).

    format: `json`, `msgpack` or `raw`. describe: output → its description, where not the default.
    """

    format: str
    describe: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


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

    exec: the command as written in the scenario; `program.command` makes it one that can be run.
    every: it fires at multiples of this [steps]. publishes: whether it publishes before or after
    it reads its inputs. on_fault: how the run continues when it fails; None: it ends. bridge: how
    the program is reached where it does not speak Zenoh itself.
    """

    name: str
    exec: tuple[str, ...]
    every: int = 1
    publishes: Publishes = "last"
    inputs: Mapping[str, InputSpec] = field(default_factory=dict)
    outputs: Mapping[str, OutputSpec] = field(default_factory=dict)
    params: Mapping[str, Any] = field(default_factory=dict)
    deadlines: Deadlines = Deadlines()
    on_fault: HoldSpec | None = None
    bridge: BridgeSpec | None = None


@dataclass(frozen=True, kw_only=True)
class BusSpec:
    """How participants reach each other.

    port: first TCP port; none: any free ones. low_latency: Zenoh's low-latency transport; none:
    the orchestrator chooses.
    """

    transport: Transport = "unix"
    port: int | None = None
    low_latency: bool | None = None


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A complete scenario, checked.

    step_ns: length of a communication step [ns]. steps: how many; none: until something ends the
    run. participants: in the order of the file. window: steps that may be in flight. batch:
    outputs of a participant per log message. faults: what is done to it on purpose. folder: what
    relative file names are relative to. file: where it was read from. Two scenarios are equal when
    all but `folder` and `file` is.
    """

    name: str
    step_ns: int
    steps: int | None
    seed: int
    participants: tuple[ParticipantSpec, ...]
    bus: BusSpec = BusSpec()
    window: int = 64
    batch: int = 32
    faults: tuple[FaultSpec, ...] = ()
    folder: Path = field(compare=False)
    file: Path = field(compare=False)

    def participant(self, name: str) -> ParticipantSpec:
        """Return one participant; raises KeyError when there is none of that name."""
        return {spec.name: spec for spec in self.participants}[name]
