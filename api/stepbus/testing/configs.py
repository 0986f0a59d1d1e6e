"""Configurations of participants, made by hand or taken from a scenario."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepbus_participant import Config, PortType, parse_duration
from stepbus_schemas import InputConfig, Message, OutputConfig, Types, type_name

if TYPE_CHECKING:
    from stepbus.runs import AnyScenario
    from stepbus_orchestrator.scenario.override import Overrides


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
    """Return the configuration that a participant would get from a scenario.

    inputs, outputs: port → message type, as a class or a name. folder: what relative file names
    in `params` are relative to.
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

    scenario, set: as of `stepbus.load`. Raises ScenarioError when the scenario cannot run,
    KeyError when it has no such participant.
    """
    from stepbus.runs import load  # noqa: PLC0415  it loads the orchestrator

    loaded = load(scenario, set=set)
    spec = loaded.participant(participant)
    sources = {item.name: item for item in loaded.participants}
    return Config(
        name=spec.name,
        step_ns=loaded.step_ns,
        every=spec.every,
        seed=loaded.seed,
        folder=loaded.folder,
        inputs={
            name: InputConfig(
                source=item.source,
                port=item.port,
                type=sources[item.source].outputs[item.port].type,
                delay=item.delay,
                every=sources[item.source].every,
            )
            for name, item in spec.inputs.items()
        },
        outputs={name: OutputConfig(type=item.type) for name, item in spec.outputs.items()},
        params=spec.params,
        publishes=spec.publishes,
        types=loaded.types,
    )
