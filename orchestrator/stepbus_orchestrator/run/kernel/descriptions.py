"""Whether what a participant says of its outputs fits together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from stepbus_orchestrator.errors import StartFailed
from stepbus_schemas import Description

from .participants import Member, Roster


def check_descriptions(roster: Roster, inputs: Mapping[str, Mapping[str, Description]]) -> None:
    """Check the descriptions of all who are ready.

    inputs: participant → input → its description.

    Raises StartFailed that lists all that is wrong with those of one participant.
    """
    for member in roster.values():
        problems = list(_problems(member, inputs[member.name]))
        if problems:
            raise StartFailed(
                f"before the first step: {member.who()} describes its outputs wrongly: "
                f"{'; '.join(problems)}",
                participant=member.name,
            )


def _problems(member: Member, inputs: Mapping[str, Description]) -> Iterator[str]:
    described = {} if member.ready is None else member.ready.outputs
    for port, said in described.items():
        if port not in member.spec.outputs:
            yield f"{port!r} is no output of it; {_known(member.spec.outputs)}"
        elif said.like is not None and said.like not in inputs:
            yield f"{port} is like {said.like!r}, which is no input of it; {_known(inputs)}"
        else:
            names = said.names if said.like is None else inputs[said.like].names
            yield from (f"{port}: {what}" for what in _misfits(said, names))


def _known(ports: Iterable[str]) -> str:
    return f"it has {', '.join(ports) or 'none'}"


def _misfits(said: Description, names: list[str]) -> Iterator[str]:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        yield f"{', '.join(twice)} is there twice"
    lengths = {
        **{f"limits.{key}": len(row) for key, row in said.limits.items()},
        **{f"details.{key}": len(row) for key, row in said.details.items()},
    }
    for row, length in lengths.items():
        if length != len(names):
            yield f"{row} has {length} values for {len(names)} names"
