"""Test your own participants without processes, bus or orchestrator.

```python
from stepbus import JointCommand, JointState
from stepbus.testing import Bench, make_config

def test_it_pushes_back():
    config = make_config(inputs={"joint_state": JointState}, outputs={"command": JointCommand})
    bench = Bench(MyController, config)
    command = bench.step(joint_state=JointState(position=[0.1]))["command"]
    assert command.values[0] < 0
```
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from stepbus_participant import (
    Config,
    Input,
    LoopbackBus,
    OutputPorts,
    Participant,
    PortType,
    Step,
    names_of,
    parse_duration,
    suggest,
)
from stepbus_schemas import (
    Description,
    InputConfig,
    Message,
    OutputConfig,
    StepbusError,
    Types,
    WiringError,
    encode,
    type_name,
)

if TYPE_CHECKING:
    from stepbus.runs import AnyScenario
    from stepbus_orchestrator.recording.layout import Source
    from stepbus_orchestrator.replay import ReplayResult
    from stepbus_orchestrator.scenario.override import Overrides

__all__ = [
    "Bench",
    "LoopbackBus",
    "assert_replays",
    "feed",
    "make_config",
    "scenario_config",
]


def make_config(
    *,
    name: str = "participant",
    inputs: Mapping[str, PortType] | None = None,
    outputs: Mapping[str, PortType] | None = None,
    params: Mapping[str, Any] | None = None,
    step: str = "5ms",
    every: int = 1,
    seed: int = 0,
    folder: str | PathLike[str] = ".",
    publishes: str = "last",
) -> Config:
    """Return a configuration such as a participant gets from a scenario.

    inputs, outputs: port → message type, as a class or a name. folder: base of relative file names
    in `params`.
    """
    return Config(
        name=name,
        step_ns=parse_duration(step),
        every=every,
        seed=seed,
        folder=Path(folder),
        inputs={
            port: InputConfig(source="test", port=port, type=_name(type_))
            for port, type_ in (inputs or {}).items()
        },
        outputs={port: OutputConfig(type=_name(type_)) for port, type_ in (outputs or {}).items()},
        params=params or {},
        publishes=publishes,
        types=Types.of(_classes(inputs, outputs)),
    )


def _classes(*sides: Mapping[str, PortType] | None) -> list[type[Message]]:
    return [item for side in sides for item in (side or {}).values() if isinstance(item, type)]


def _name(port_type: PortType) -> str:
    return port_type if isinstance(port_type, str) else type_name(port_type)


def scenario_config(
    scenario: AnyScenario,
    participant: str,
    *,
    set: Overrides = (),  # noqa: A002  as --set on the command line
) -> Config:
    """Return the configuration that a participant gets in a scenario; its seed is the scenario's.

    scenario, set: as in `stepbus.load`. Raises ScenarioError when the scenario cannot run, KeyError
    when it has no such participant.
    """
    from stepbus.runs import load  # noqa: PLC0415  it loads the orchestrator
    from stepbus_orchestrator.run.kernel.admission import welcome_of  # noqa: PLC0415

    loaded = load(scenario, set=set)
    welcome = welcome_of(loaded, loaded.participant(participant), "")
    return replace(Config.from_welcome(welcome, loaded.types), seed=loaded.seed)


_AT_ONCE = -1
"""What a source has published before any step is due at every step."""


def feed(index: int = 0, /, *, step: str = "5ms", **messages: Message) -> Step:
    """Return a step with these messages as new inputs.

    index: step number. step: step length. messages: by input port.
    """
    types = Types.of(map(type, messages.values()))
    inputs = {
        port: Input(
            port, InputConfig(source="test", port=port, type=type_name(type(message))), types
        )
        for port, message in messages.items()
    }
    fed = Step(inputs, parse_duration(step))
    fed.index = index
    _deliver(inputs, messages, index)
    return fed


def _deliver(inputs: Mapping[str, Input], messages: Mapping[str, Message], step: int) -> None:
    """Give inputs their messages as the bus delivers them; the others keep what they have."""
    for name, message in messages.items():
        if name not in inputs:
            raise WiringError(f"unknown input {name!r}{suggest(name, inputs)}")
        wanted, got = inputs[name].config.type, type_name(type(message))
        if got != wanted:
            raise WiringError(f"input {name!r} takes {wanted}, got {got}")
        inputs[name].pending.append((_AT_ONCE, encode(message)))
    for port in inputs.values():
        port.settle(step)


def _declared(factory: Callable[[Config], Participant]) -> Config:
    """Return a configuration with the ports that the class of a participant declares."""
    inputs, outputs = (getattr(factory, side, None) for side in ("inputs", "outputs"))
    return make_config(inputs=inputs, outputs=outputs)


class Bench:
    """One participant without processes and bus, created, described and started as in a run.

    factory: creates the participant, usually its class; or a participant that has already started.
    config: see `make_config` and `scenario_config`; default: that of the started participant, or
    the ports that its class declares. descriptions: descriptions of its inputs; default: an empty
    one for each.

    participant: the participant. descriptions: descriptions of its outputs. index: number of the
    next step.
    """

    def __init__(
        self,
        factory: Callable[[Config], Participant] | Participant,
        config: Config | None = None,
        descriptions: Mapping[str, Description] | None = None,
    ) -> None:
        if isinstance(factory, Participant):
            self.config, self.participant = config or factory.config, factory
        else:
            self.config = config or _declared(factory)
            self.participant = factory(self.config)
        inputs, outputs, types = self.config.inputs, self.config.outputs, self.config.types
        self.descriptions = dict(self.participant.describe())
        self.index = 0
        self._inputs = {name: Input(name, item, types) for name, item in inputs.items()}
        self._ports = OutputPorts(outputs, types, decodes_all=True)
        given = descriptions or {}
        self._ports.set_names(names_of(self.descriptions, given))
        self._step = Step(self._inputs, self.config.step_ns)
        if self.participant is not factory:
            self.participant.start({port: given.get(port, Description()) for port in inputs})

    def step(self, index: int | None = None, /, **messages: Message) -> dict[str, Any]:
        """Run one step and return the outputs that the participant publishes, by port.

        index: step number; default: the next one. messages: by input port; other inputs keep their
        last message, which is not new.

        Raises OutputError for a message that cannot be sent: on a port that the configuration
        lacks, of the wrong type, or with a field of the wrong type. Errors of the participant pass
        through.
        """
        step = self._step
        step.index = self.index if index is None else index
        self.index = step.index + self.config.every
        is_first = self.config.publishes == "first"
        published = dict(self.participant.output(step)) if is_first else {}
        _deliver(self._inputs, messages, step.index)
        updated = self.participant.update(step)
        if not is_first:
            published = dict(updated or {})
        for port, message in published.items():
            self._ports.encode(step.index, port, message)
        return published

    def call(self, verb: str, *args: Any) -> Any:
        """Call a method of the participant between two steps and return the answer."""
        return self.participant.calls()[verb].function(*args)

    @property
    def end_reason(self) -> str | None:
        """Return why the participant requests the end of the run; None if it does not."""
        return self._step.end_reason

    def close(self) -> None:
        """Close the participant."""
        self.participant.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exc: object) -> None:
        self.close()


def assert_replays(recording: Source, participant: str, **options: Any) -> ReplayResult:
    """Replay a participant and return the result; options: as in `stepbus.replay`.

    Raises AssertionError with the first difference, or with the error, when it is not equal.
    """
    from stepbus import replay  # noqa: PLC0415  it loads the orchestrator
    from stepbus_orchestrator.recording.layout import recording_file  # noqa: PLC0415

    __tracebackhide__ = True
    path = recording_file(recording)
    try:
        result = replay(path, participant, **options)
    except StepbusError as exc:
        # Its sentence is complete; where it was raised is no line of the user's program.
        raise AssertionError(f"{path}: {exc}") from None
    if not result.equal:
        raise AssertionError(f"{path}: {result.text()}")
    return result
