"""Protocol 1: the envelopes between participants and the orchestrator (docs/protocol.md).

Each envelope is a MessagePack map. Unknown fields are ignored, missing or mistyped ones are
refused. `token` is the run's secret: an envelope without the right one changes nothing.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec

PROTOCOL_VERSION = 1
HANDSHAKE_STEP = -1
"""The step of an `Outputs` that proves a connection and carries no data."""

NonNegative = Annotated[int, msgspec.Meta(ge=0)]
Positive = Annotated[int, msgspec.Meta(ge=1)]
Publishes = Literal["first", "last"]


class Envelope(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What every protocol message is."""


class Description(Envelope, frozen=True):
    """What one output carries: who its vectors belong to, in which order, within which limits."""

    names: list[str] = []
    """Names of joints, wheels or cameras, in the order of every vector of the port."""
    like: str | None = None
    """Name of an input of the same participant whose `names` hold for this output too."""
    units: dict[str, str] = {}
    """Unit of each field, where it differs from the message type's."""
    limits: dict[str, list[float]] = {}
    """`lower`, `upper` [rad], `velocity` [rad/s], `effort` [N·m]; each in the order of `names`."""
    shape: list[int] = []
    """Shape of bulk data, e.g. [height, width, channels]."""
    details: dict[str, list[str]] = {}
    """Anything else worth telling per name, e.g. `type` and `mode` of each joint."""


class InputConfig(Envelope, frozen=True):
    """Where one input comes from and when."""

    source: str
    """Name of the participant it comes from."""
    port: str
    """Name of that participant's output."""
    type: str
    """Message type, `Name/major`."""
    delay: NonNegative = 0
    """How many steps old the source's output has to be at least [steps]."""
    every: Positive = 1
    """At which steps the source fires: multiples of this [steps]."""
    bulk: bool = False
    """Whether the content travels on `bulk/<source>/<port>`."""


class OutputConfig(Envelope, frozen=True):
    """What one output publishes."""

    type: str
    """Message type, `Name/major`."""
    bulk: bool = False
    """Whether the content travels on `bulk/<participant>/<port>`."""


class Hello(Envelope, frozen=True):
    """A participant asks to join."""

    protocol: int
    """Version of the protocol the program speaks."""
    name: str
    """Name of the participant, from its ticket."""
    token: str
    """The run's secret, from the ticket."""
    pid: int
    """Process id, for messages to people."""
    language: str = ""
    """What the program is written in, e.g. `python`."""
    sdk: str = ""
    """Library it takes part with, and its version."""
    inputs: dict[str, str] | None = None
    """Input ports the program knows, with their types; none: it takes what the scenario says."""
    outputs: dict[str, str] | None = None
    """Output ports the program knows, with their types; none: as above."""


class Welcome(Envelope, frozen=True):
    """The orchestrator takes a participant in and tells it all it has to know."""

    protocol: int
    """Version of the protocol the orchestrator speaks."""
    name: str
    """Name of the participant."""
    token: str
    """The run's secret."""
    step_ns: Positive
    """Length of a step [ns]."""
    every: Positive
    """The participant fires at multiples of this [steps]."""
    publishes: Publishes
    """Whether its outputs of a step come before or after it reads its inputs."""
    window: Positive
    """How many steps may be in flight [steps]."""
    batch: Positive
    """How many `Outputs` at most go into one `Log`."""
    seed: NonNegative
    """Seed of the participant's own, derived from the run's seed and its name."""
    inputs: dict[str, InputConfig]
    """Input → where it comes from."""
    outputs: dict[str, OutputConfig]
    """Output → what it publishes."""
    params: dict[str, Any]
    """The participant's `params`, as written in the scenario."""
    folder: str
    """Absolute path of the folder that relative file names in `params` are relative to."""
    max_outputs_bytes: Positive = 60_000
    """Largest `Outputs` the bus carries; larger content belongs on a bulk port [bytes]."""


class Refusal(Envelope, frozen=True):
    """The orchestrator does not take a participant in."""

    reason: str
    """One sentence for the user."""


class CallDescription(Envelope, frozen=True):
    """Something a participant can be asked between two steps."""

    help: str
    """Arguments and answer in one line, e.g. `NAME: position of a joint [rad]`."""
    changes: bool = False
    """Whether it changes the result; such calls are recorded with their step."""


class Ready(Envelope, frozen=True):
    """The model is loaded and every source has been heard."""

    name: str
    """Name of the participant."""
    token: str
    """The run's secret."""
    outputs: dict[str, Description] = {}
    """Output → its description."""
    versions: dict[str, str] = {}
    """Versions of the libraries that shape the result, e.g. {"pybullet": "3.2.7"}."""
    calls: dict[str, CallDescription] = {}
    """Name → what the participant can be asked."""


class Start(Envelope, frozen=True):
    """All are ready; the descriptions of each participant's inputs. The clock stands at zero."""

    token: str
    """The run's secret."""
    inputs: dict[str, dict[str, Description]]
    """Participant → its input → description."""


class Trigger(Envelope, frozen=True):
    """Permission to work on every step below `step_limit`."""

    token: str
    """The run's secret."""
    step_limit: NonNegative
    """First step that is not yet allowed; it never shrinks."""


class Outputs(Envelope, frozen=True):
    """All a participant publishes at one step."""

    token: str
    """The run's secret."""
    step: int
    """Number of the step; -1: a handshake that carries no data."""
    t_ns: int
    """Simulation time, step · step_ns [ns]."""
    ports: dict[str, msgspec.Raw] = {}
    """Output → its message, a MessagePack map."""
    bulk: dict[str, NonNegative] = {}
    """Bulk ports published at this step, with the length of their content [bytes]."""
    end: str | None = None
    """Why the run shall end after this step; absent in all others."""


class Waiting(Envelope, frozen=True):
    """What a participant has been waiting for when it flushed its log."""

    step: int
    """The step it waits to do."""
    sources: list[str]
    """Participants whose outputs have not arrived; empty: it waits for the trigger."""


class Log(Envelope, frozen=True):
    """Outputs of one participant on their way to the recording."""

    name: str
    """Name of the participant."""
    token: str
    """The run's secret."""
    outputs: list[msgspec.Raw] = []
    """The `Outputs`, byte for byte as they were published, in the order of their steps."""
    timing: list[tuple[int, int, int]] = []
    """(step, waited [ns], computed [ns]) of each finished step."""
    waiting: Waiting | None = None
    """What it waits for; absent while it works."""
    drops: dict[str, int] = {}
    """Messages dropped so far, by cause: `duplicate`, `stale`, `unauthenticated`, `malformed`."""


class Fault(Envelope, frozen=True):
    """A participant cannot go on."""

    name: str
    """Name of the participant."""
    token: str
    """The run's secret."""
    step: int
    """The step it was at; negative: before the first."""
    type: str
    """`raised`, `message`, `wiring` or `bus`."""
    message: str
    """One sentence for the user."""
    traceback: str = ""
    """Where in the program it happened, for its author."""
    blames: str | None = None
    """Whose fault it is, when it is not the sender's own."""


class Stop(Envelope, frozen=True):
    """The run ends. `at_step`: publish what is due first at it, then end; negative: end now."""

    token: str
    """The run's secret."""
    reason: str
    """Why the run ends, one sentence."""
    at_step: int
    """The step to publish what is due first at, then end; negative: end now."""


class Call(Envelope, frozen=True):
    """The orchestrator asks a participant something, before it lets it begin a step."""

    token: str
    """The run's secret."""
    id: NonNegative
    """Number of the call; it grows. One that is repeated is answered again, not done again."""
    method: str
    """What is asked, one of `Ready.calls`."""
    args: list[Any] = []
    """Arguments."""


class Called(Envelope, frozen=True):
    """The answer to a `Call`."""

    name: str
    """Name of the participant."""
    token: str
    """The run's secret."""
    id: NonNegative
    """Number of the call."""
    value: Any = None
    """The answer; anything MessagePack has."""
    error: str | None = None
    """Why there is no answer, one sentence; then nothing was done."""


class CallRequest(Envelope, frozen=True):
    """Somebody outside of the run asks the orchestrator to call a participant."""

    token: str
    """The run's secret."""
    participant: str = ""
    """Whom to call; empty: the answer lists what everybody can be asked."""
    method: str = ""
    """What to ask."""
    args: list[Any] = []
    """Arguments."""


class CallReply(Envelope, frozen=True):
    """The orchestrator's answer to a `CallRequest`."""

    step: int = -1
    """The step before which the call was answered; negative: it was not made."""
    value: Any = None
    """The answer."""
    error: str | None = None
    """Why there is none, one sentence."""


class CallRecord(Envelope, frozen=True):
    """A call that changed the result, as it is recorded on the channel `stepbus/calls`."""

    step: NonNegative
    """The step before which it was done."""
    participant: str
    """Who was called."""
    method: str
    """What was asked."""
    args: list[Any] = []
    """Arguments."""
    value: Any = None
    """The answer."""
    error: str | None = None
    """Why there was none."""


CHAIN_EVERY = 64
"""A `Chain` is recorded at least this often [steps]."""


class Chain(Envelope, frozen=True):
    """Where the hash chain of each participant stands; the orchestrator records it.

    The chain is SHA-256 over its previous value (32 zero bytes at first), the step (int64,
    little-endian) and, for each port in the order of the scenario, its name and the recorded
    bytes. Two recordings with equal values have equal outputs up to this step.
    """

    step: int
    """The last step the values cover."""
    hashes: dict[str, str]
    """Participant → SHA-256 in hexadecimal."""


ENVELOPE_TYPES: dict[str, type[Envelope]] = {
    "Call/1": Call,
    "CallRecord/1": CallRecord,
    "CallReply/1": CallReply,
    "CallRequest/1": CallRequest,
    "Called/1": Called,
    "Chain/1": Chain,
    "Fault/1": Fault,
    "Hello/1": Hello,
    "Log/1": Log,
    "Outputs/1": Outputs,
    "Ready/1": Ready,
    "Refusal/1": Refusal,
    "Start/1": Start,
    "Stop/1": Stop,
    "Trigger/1": Trigger,
    "Welcome/1": Welcome,
}
