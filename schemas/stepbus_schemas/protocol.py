"""Protocol 2: the envelopes between participants and the orchestrator (docs/protocol.md).

Each envelope is a MessagePack map. Unknown fields are ignored; missing or mistyped ones make it
malformed. `token` is the run's secret: an envelope without it changes nothing.
"""

from typing import Annotated, Any, Literal

import msgspec

PROTOCOL_VERSION = 2
"""Every change of a layout raises it; docs/protocol.md lists the changes (P14.1)."""
HANDSHAKE_STEP = -1
"""The step of an `Outputs` that proves a link and carries no data."""

_NonNegative = Annotated[int, msgspec.Meta(ge=0)]
_Positive = Annotated[int, msgspec.Meta(ge=1)]
_Publishes = Literal["first", "last"]


class _Part(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Base of what is nested in protocol messages."""


class Envelope(_Part, frozen=True):
    """Base of every protocol message."""


class _Signed(Envelope, frozen=True):
    """Base of the envelopes that begin with the token."""

    token: str
    """The run's secret."""


class _FromParticipant(Envelope, frozen=True):
    """Base of the envelopes that a participant signs."""

    name: str
    """Name of the participant."""
    token: str
    """The run's secret."""


_SLIDING = {"rad": "m", "rad/s": "m/s", "rad/s²": "m/s²", "N·m": "N"}


class Description(_Part, frozen=True):
    """Description of one output: names, order and limits of its vectors."""

    names: list[str] = []
    """Names of joints, wheels or cameras, in the order of every vector of the port."""
    like: str | None = None
    """Input of the same participant whose `names` apply to this output too."""
    units: dict[str, str] = {}
    """Field → unit, if it differs from the message type's."""
    limits: dict[str, list[float]] = {}
    """`lower`, `upper` [rad], `velocity` [rad/s], `effort` [N·m]; each in the order of `names`."""
    shape: list[int] = []
    """Shape of bulk data, e.g. [height, width, channels]."""
    details: dict[str, list[str]] = {}
    """Further properties per name, e.g. `type` and `mode` of each joint."""

    def unit(self, unit: str, joint: int) -> str:
        """Return the unit of a joint, by its index; unit: that of one that turns."""
        slides = self.details.get("type", [])[joint : joint + 1] == ["prismatic"]
        return _SLIDING.get(unit, unit) if slides else unit


class InputConfig(_Part, frozen=True):
    """Source and timing of one input."""

    source: str
    """Name of the source."""
    port: str
    """Name of the source's output."""
    type: str
    """Message type, `Name/major`."""
    delay: _NonNegative = 0
    """Minimum age of the source's output [steps]."""
    every: _Positive = 1
    """The source fires at multiples of this [steps]."""
    bulk: bool = False
    """Whether the content travels on `bulk/<source>/<port>`."""


class OutputConfig(_Part, frozen=True):
    """Type and transport of one output."""

    type: str
    """Message type, `Name/major`."""
    bulk: bool = False
    """Whether the content travels on `bulk/<participant>/<port>`."""


class Hello(Envelope, frozen=True):
    """A participant's request to join."""

    protocol: int
    """Highest protocol version that the program speaks."""
    name: str
    """Name of the participant, from its ticket."""
    token: str
    """The run's secret, from the ticket."""
    pid: int
    """Process id, for messages to the user."""
    language: str = ""
    """Programming language, e.g. `python`."""
    sdk: str = ""
    """Client library and its version."""
    inputs: dict[str, str] | None = None
    """Input ports that the program requires, with their types; absent: any."""
    outputs: dict[str, str] | None = None
    """Output ports that the program requires, with their types; absent: any."""
    types: dict[str, dict[str, Any]] = {}
    """Type → its declaration in the program, for types that do not ship with stepbus."""
    batches: bool = False
    """Whether the program takes a `Batch` in place of an `Outputs` from its sources."""
    lowest_protocol: int | None = None
    """Lowest protocol version that the program speaks; absent: `protocol` is the only one."""


class Welcome(Envelope, frozen=True):
    """The orchestrator admits a participant, and configures it."""

    protocol: int
    """Protocol version that both speak: the highest that the program and the run have in common."""
    name: str
    """Name of the participant."""
    token: str
    """The run's secret."""
    step_ns: _Positive
    """Length of a step [ns]."""
    every: _Positive
    """The participant fires at multiples of this [steps]."""
    publishes: _Publishes
    """Whether it publishes its outputs before or after it reads its inputs."""
    window: _Positive
    """Maximum number of steps in flight [steps]."""
    batch: _Positive
    """Maximum number of `Outputs` in one `Log`."""
    seed: _NonNegative
    """The participant's own seed, derived from the run's seed and its name."""
    inputs: dict[str, InputConfig]
    """Input → its source."""
    outputs: dict[str, OutputConfig]
    """Output → its type."""
    params: dict[str, Any]
    """The participant's `params`, as written in the scenario."""
    folder: str
    """Absolute path of the folder for relative file names in `params`."""
    max_outputs_bytes: _Positive = 60_000
    """Maximum size of an `Outputs`; larger content belongs on a bulk port [bytes]."""
    types: dict[str, dict[str, Any]] = {}
    """Type → its declaration, of the port types that do not ship with stepbus."""


class Refusal(Envelope, frozen=True):
    """The orchestrator refuses a participant."""

    reason: str
    """Message for the user."""


class CallDescription(_Part, frozen=True):
    """A method of a participant that can be called between two steps."""

    help: str
    """Arguments and answer in one line, e.g. `NAME: position of a joint [rad]`."""
    changes: bool = False
    """Whether it may change the result; such calls are recorded with their step."""


class Ready(_FromParticipant, frozen=True):
    """The model is loaded, and every source is connected."""

    outputs: dict[str, Description] = {}
    """Output → its description."""
    versions: dict[str, str] = {}
    """Library → version, for libraries that affect the result, e.g. {"pybullet": "3.2.7"}."""
    calls: dict[str, CallDescription] = {}
    """Name → method that can be called."""
    slots: list[str] = []
    """Bulk outputs, `<participant>.<port>`, whose slot file it has opened."""


class Start(_Signed, frozen=True):
    """All participants are ready: the run starts at step 0."""

    inputs: dict[str, dict[str, Description]]
    """Participant → input → description."""
    batches: dict[str, _Positive] = {}
    """Participant → maximum number of `Outputs` it may publish in one `Batch`; absent: none."""
    slots: dict[str, _Positive] = {}
    """Bulk output, `<participant>.<port>`, that uses slots → number of slots."""


class Trigger(_Signed, frozen=True):
    """Permission to work on all steps below `step_limit`."""

    step_limit: _NonNegative
    """First step not released yet; never decreases."""


class Outputs(_Signed, frozen=True):
    """All outputs of a participant at one step."""

    step: int
    """Number of the step; -1: a handshake, which carries no data."""
    t_ns: int
    """Simulation time, step · step_ns [ns]."""
    ports: dict[str, msgspec.Raw] = {}
    """Output → its message, a MessagePack map."""
    bulk: dict[str, _NonNegative] = {}
    """Bulk port published at this step → length of its content [bytes]."""
    slots: dict[str, _NonNegative] = {}
    """Bulk port whose content is in a slot → offset of the slot in the file [bytes]."""
    end: str | None = None
    """Why the run should end after this step; otherwise absent."""


class Batch(_Signed, frozen=True):
    """Several steps of a participant that no other waits for, in one message."""

    outputs: list[msgspec.Raw]
    """`Outputs`, in the order of their steps."""


class Waiting(_Part, frozen=True):
    """What a participant waits for."""

    step: int
    """The step it waits for."""
    sources: list[str]
    """Sources whose outputs are missing; empty: it waits for the trigger."""


class Log(_FromParticipant, frozen=True):
    """A batch of outputs of one participant, for the recording."""

    outputs: list[msgspec.Raw] = []
    """The `Outputs`, byte for byte as published, in the order of their steps."""
    timing: list[tuple[int, int, int]] = []
    """(step, waited [ns], computed [ns]) of each finished step."""
    waiting: Waiting | None = None
    """What it waits for; absent while it computes."""
    drops: dict[str, int] = {}
    """Cause → messages dropped so far: `duplicate`, `malformed`, `stale`, `unauthenticated`."""


class Fault(_FromParticipant, frozen=True):
    """A participant cannot continue."""

    step: int
    """The step it was executing; negative: before the first."""
    type: str
    """Type of the fault: `raised`, `message`, `wiring` or `bus`."""
    message: str
    """Message for the user."""
    traceback: str = ""
    """Stack trace, for the author of the program."""
    blames: str | None = None
    """Participant that caused it, if not the sender."""


class Stop(_Signed, frozen=True):
    """The run ends."""

    reason: str
    """Why the run ends, for the user."""
    at_step: int
    """Number of steps of the run, after which to end (P11); negative: end now."""


class Call(_Signed, frozen=True):
    """The orchestrator calls a method of a participant, between two steps."""

    id: _NonNegative
    """Number of the call, increasing; a repeated call is answered again, but not executed."""
    method: str
    """Name of the method, one of `Ready.calls`."""
    args: list[Any] = []
    """Arguments."""


class Called(_FromParticipant, frozen=True):
    """The answer to a `Call`."""

    id: _NonNegative
    """Number of the call."""
    value: Any = None
    """Return value; any MessagePack value."""
    error: str | None = None
    """Why the call failed, for the user; a failed call changes nothing."""


class CallRequest(_Signed, frozen=True):
    """A request from outside the run to call a participant."""

    participant: str = ""
    """Participant to call; empty: the reply lists all methods."""
    method: str = ""
    """Name of the method."""
    args: list[Any] = []
    """Arguments."""


class CallReply(Envelope, frozen=True):
    """The orchestrator's answer to a `CallRequest`."""

    step: int = -1
    """The step before which the call was answered; negative: it was not executed."""
    value: Any = None
    """Return value."""
    error: str | None = None
    """Why the call failed, for the user."""


class CallRecord(Envelope, frozen=True):
    """A call that may change the result, as recorded on the channel `stepbus/calls`."""

    step: _NonNegative
    """The step before which it was executed."""
    participant: str
    """Participant that was called."""
    method: str
    """Name of the method."""
    args: list[Any] = []
    """Arguments."""
    value: Any = None
    """Return value."""
    error: str | None = None
    """Why the call failed."""


CHAIN_EVERY = 64
"""A `Chain` is recorded at least this often [steps]."""


class Chain(Envelope, frozen=True):
    """The hash chain of each participant, recorded by the orchestrator.

    The chain is SHA-256 over its previous value (32 zero bytes at first), the step (int64,
    little-endian) and, for each port in the order of the scenario, its name and the recorded
    bytes. Two recordings with equal values have equal recorded outputs up to this step.
    """

    step: int
    """Last step that the hashes cover."""
    hashes: dict[str, str]
    """Participant → SHA-256 in hexadecimal."""


ENVELOPE_TYPES: dict[str, type[Envelope]] = dict(
    sorted(
        (f"{cls.__name__}/1", cls)
        for base in (Envelope, _Signed, _FromParticipant)
        for cls in base.__subclasses__()
        if not cls.__name__.startswith("_")
    )
)


def due_step(step: int, delay: int = 0, every: int = 1) -> int:
    """Return the step whose message an input takes at `step` (P6.1); `-every` or less: none yet.

    delay: least age of the message [steps]. every: its source fires at multiples of this [steps].
    """
    reach = step - delay
    return reach - reach % every


class Protocols(msgspec.Struct, frozen=True):
    """A range of protocol numbers, with both ends; empty where lowest > highest."""

    lowest: int
    highest: int

    def __str__(self) -> str:
        """Return `protocol 2`, or `protocols 2 to 3`."""
        if self.lowest == self.highest:
            return f"protocol {self.highest}"
        return f"protocols {self.lowest} to {self.highest}"

    def common(self, other: "Protocols") -> int | None:
        """Return the highest number that is in both ranges; None where there is none."""
        lowest, highest = max(self.lowest, other.lowest), min(self.highest, other.highest)
        return highest if lowest <= highest else None


SPOKEN = Protocols(PROTOCOL_VERSION, PROTOCOL_VERSION)
"""What the orchestrator and the participants of this library speak."""


def offered(hello: Hello) -> Protocols:
    """Return the numbers that a program speaks."""
    lowest = hello.lowest_protocol
    return Protocols(hello.protocol if lowest is None else lowest, hello.protocol)
