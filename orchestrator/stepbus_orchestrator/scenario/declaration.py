"""What a scenario file may say: every key, declared once.

From here come reading, the tables of docs/reference/scenario.md and the JSON Schema for editors.
Defaults, and what is read as it is, are in `model.py`.
"""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

import msgspec

from stepbus_orchestrator.scenario.model import (
    BridgeSpec,
    BusSpec,
    Deadlines,
    HoldSpec,
    InputSpec,
    OnLate,
    OutputSpec,
    ParticipantSpec,
    Publishes,
    Start,
)
from stepbus_orchestrator.scenario.model import Scenario as Model
from stepbus_participant import Count, Duration, Name, Settings, Whole, suggest, when
from stepbus_participant.parameters import Keys
from stepbus_schemas import Description, explained


class InputRow(Settings):
    """Where an input comes from."""

    short = "from"

    from_: str
    """`participant.output`; not an output of the participant itself."""
    delay: Whole = InputSpec.delay
    """How many steps old it is at least."""
    type: str | None = None
    """A message type this participant insists on; it is checked against the output's."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what cannot be an output."""
        if not is_output(self.from_):
            text = f"must be PARTICIPANT.OUTPUT, e.g. plant.joint_state, not {self.from_!r}"
            yield ("from",), text


class ParticipantRow(Settings):
    """A participant."""

    template: str | None = None
    """The one of `templates` it is made from."""
    with_: dict[str, Any] = {}
    """Parameter of the template → its value."""
    participant: str | None = None
    """The class that it is, in Python: `my_controller.py:Controller` of a file beside the scenario,
    `my_arm.controller:Controller` of a module; or else `exec`."""
    exec: tuple[str, ...] = ()
    """The command that starts it, for a program in any language; see below."""
    every: Count = ParticipantSpec.every
    """It fires at steps 0, `every`, 2 · `every` …"""
    publishes: Publishes = ParticipantSpec.publishes
    """Whether it publishes before it reads its inputs (a plant: its state) or after (a controller).
    """
    inputs: dict[Name, InputRow] = {}
    """Port → what it reads."""
    outputs: dict[Name, OutputSpec] = {}
    """Port → what it publishes."""
    params: dict[str, Any] = {}
    """For the participant alone; checked where it declares them
    ([parameters.md](parameters.md))."""
    start: Start = ParticipantSpec.start
    """Who starts it: the orchestrator, or you, with `stepbus join`
    ([attach.md](../guide/running/attach.md)). Changes no result."""
    real_time: bool = ParticipantSpec.real_time
    """Whether it has to keep time in a run in real time
    ([real_time.md](../guide/running/real_time.md)). Changes no result."""
    on_late: Annotated[OnLate, when(real_time=True)] = ParticipantSpec.on_late
    """Whether the run counts its late steps, or fails at the first."""
    spawn_timeout_ns: Duration | None = None
    """Until its process is on the bus. Default: 20s, with `start: external` 2min."""
    join_timeout_ns: Duration = round(Deadlines.join_s * 1e9)
    """From there until it has joined."""
    ready_timeout_ns: Duration = round(Deadlines.ready_s * 1e9)
    """From there until its model is loaded and it is connected to its sources."""
    step_timeout_ns: Duration = round(Deadlines.step_s * 1e9)
    """How long it may hold a step."""
    stop_timeout_ns: Duration = round(Deadlines.stop_s * 1e9)
    """From the request to stop until its process has ended."""
    on_fault: Literal["stop", "hold"] | HoldSpec = "stop"
    """What happens when it fails: the run ends, or everything is first brought to rest
    ([faults.md](../faults.md))."""
    bridge: BridgeSpec | None = None
    """`exec` is a program in any language that reads descriptor 3 and writes descriptor 4
    ([bridge.md](../guide/writing/bridge.md))."""

    files: tuple[str, ...] = ()
    """What it loads beside [what is recorded anyway](#files): patterns and folders, such as
    `[build/, "../data/*.csv"]`, so that a run can be repeated from its recording."""

    @classmethod
    def elsewhere(cls, key: str) -> str:
        """Return where a key belongs that is none of a participant's."""
        if key == "external":
            return "a participant that you start yourself has `start: external`"
        if key == "name":
            return "the key above is the participant's name"
        if key in keys_of(ScenarioFile):
            return f"{key!r} belongs to the scenario: write it at the top, beside `participants`"
        parts = (("inputs", InputRow), ("on_fault", HoldSpec), ("bridge", BridgeSpec))
        for part, settings in parts:
            if key in keys_of(settings):
                return f"{key!r} belongs to `{part}`"
        is_near = "did you mean" in suggest(key, keys_of(cls))
        return "" if is_near else f"if the participant itself reads it, write it as params.{key}"

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong with the command, and with descriptions of outputs."""
        if self.participant is not None:
            yield from self._class_problems(self.participant)
        elif not self.exec:
            yield (), "needs either 'participant', a class, or 'exec', the command of a program"
        elif not self.exec[0]:
            yield ("exec",), "names no program"
        for index, word in enumerate(self.exec):
            if "\0" in word:
                yield ("exec", index), "must not contain a null character"
        if self.bridge is not None:
            yield from self._describe_problems(self.bridge.describe)

    def _class_problems(self, name: str) -> Iterator[tuple[Keys, str]]:
        given = {"exec": self.exec, "bridge": self.bridge}
        for key in (key for key, value in given.items() if value):
            text = f"is for a program; {name} is a class (`participant`); leave out one of them"
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
            for key in description:
                if key not in Description.__struct_fields__:
                    known = Description.__struct_fields__
                    yield (*keys, key), f"unknown key {key!r}{suggest(key, known)}"
            try:
                msgspec.convert(description, Description)
            except msgspec.ValidationError as exc:
                yield keys, explained(exc, Description)


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
    """Faults on purpose: `kill plant at 120`, `random 3` ([faults.md](../faults.md))."""
    participants: dict[Name, ParticipantRow]
    """Name → participant, at least one; where several could go first within a step, they go in
    this order."""
    window: Count = Model.window
    """Steps in flight; 1: nobody starts a step before all have finished the one before. Changes no
    result."""
    batch: Count | None = None
    """Outputs of a participant per message to the recording; at most half the window. Changes no
    result. Default: half the window."""
    checkpoint_ns: Duration | None = None
    """How often participants save their state, in whole steps, so that a branch need not start at
    step 0 ([branch.md](../guide/testing/branch.md#checkpoints)). Changes no result. Default:
    never."""
    bus: BusSpec = BusSpec()
    """How participants reach each other. Changes no result."""
    types: str | dict[str, Any] | tuple[str | dict[str, Any], ...] = {}
    """Message types of your own: declared here, in YAML files, or as classes in installed Python
    modules; also a list of these ([message_types.md](../guide/writing/message_types.md))."""
    templates: dict[Name, dict[str, Any]] = {}
    """Participants to be: name → keys of a participant, with parameters `${…}`; see below."""
    extends: str | None = None
    """Scenario that this one changes: a file or folder, or one that ships; see below."""

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


def is_output(text: str) -> bool:
    """Return whether a text has the form `participant.output`."""
    source, _, port = text.partition(".")
    return bool(source and port) and "." not in port
