"""How participants describe their outputs: inherited along `like`, and checked (P4.7)."""

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeVar

import msgspec

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.recording import Descriptions
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_schemas import Decoder, Description, Message, MessageError, type_name

from .participants import Participants, ParticipantState

_Message = TypeVar("_Message", bound=Message)


def input_descriptions(
    scenario: Scenario, outputs: Descriptions
) -> dict[str, dict[str, Description]]:
    """Return the description of every input: participant → input → description."""
    return {
        spec.name: {
            port: _resolve(scenario, outputs, source.source, source.port, set())
            for port, source in spec.inputs.items()
        }
        for spec in scenario.participants
    }


def _resolve(
    scenario: Scenario,
    outputs: Descriptions,
    name: str,
    port: str,
    seen: set[tuple[str, str]],
) -> Description:
    """Return an output's description, with the names of the input it is `like`."""
    description = outputs.get(name, {}).get(port, Description())
    origin = scenario.participant(name).inputs.get(description.like or "")
    if origin is None or (name, port) in seen:
        return description
    like = _resolve(scenario, outputs, origin.source, origin.port, seen | {(name, port)})
    return msgspec.structs.replace(description, names=like.names, like=None)


def check_descriptions(
    participants: Participants, inputs: Mapping[str, Mapping[str, Description]]
) -> None:
    """Check the descriptions of all participants that are ready.

    inputs: participant → input → its description.

    Raises StartFailed that lists all that is wrong with those of one participant.
    """
    for participant in participants.values():
        problems = list(_problems(participant, inputs[participant.name]))
        if problems:
            raise StartFailed(
                (
                    f"before the first step: {participant.who()} describes its outputs "
                    f"incorrectly: {'; '.join(problems)}"
                ),
                participant=participant.name,
            )


def _problems(participant: ParticipantState, inputs: Mapping[str, Description]) -> Iterator[str]:
    outputs = {} if participant.ready is None else participant.ready.outputs
    for port, output in outputs.items():
        if port not in participant.spec.outputs:
            yield f"{port!r} is not one of its outputs; {_known(participant.spec.outputs)}"
        elif output.like is not None and output.like not in inputs:
            yield (
                f"{port} is like {output.like!r}, which is not one of its inputs; {_known(inputs)}"
            )
        else:
            names = output.names if output.like is None else inputs[output.like].names
            yield from (f"{port}: {what}" for what in _inconsistencies(output, names))


def _known(ports: Iterable[str]) -> str:
    return f"it has {', '.join(ports) or 'none'}"


def _inconsistencies(description: Description, names: list[str]) -> Iterator[str]:
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        yield f"{', '.join(repeated)} is listed twice"
    lengths = {
        **{f"limits.{key}": len(row) for key, row in description.limits.items()},
        **{f"details.{key}": len(row) for key, row in description.details.items()},
    }
    for row, length in lengths.items():
        if length != len(names):
            yield f"{row} has {length} values for {len(names)} names"


def newest_of(
    cls: type[_Message],
    scenario: Scenario,
    descriptions: Descriptions,
    newest: Mapping[str, Mapping[str, Any]],
) -> Iterator[tuple[str, _Message, Description]]:
    """Yield port, newest message and description of each output of a type.

    descriptions: of all outputs. newest: participant → port → its newest message.
    """
    decode = Decoder(cls)
    for spec in scenario.participants:
        for port, output in spec.outputs.items():
            data = newest.get(spec.name, {}).get(port)
            if data is not None and output.type == type_name(cls):
                # What the recorder refuses, and with it the run, is no message.
                with contextlib.suppress(MessageError):
                    description = descriptions.get(spec.name, {}).get(port, Description())
                    yield port, decode(bytes(data)), description
