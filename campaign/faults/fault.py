"""One type of fault from outside, and what the run may do then."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from campaign.sandbox import Sandbox

Strike = Callable[[Sandbox, random.Random], None]
Prepare = Callable[[Sandbox, random.Random], Callable[[], None] | None]

START_S = 120.0
"""How long a process of the run may take to appear [s]."""

ANY_END = frozenset({0, 3, 4, 5, 6, 7, 8, 9, 130})


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One type of fault.

    strike: does it, given the sandbox and a source of chance; None where what was prepared is the
    fault. codes: exit codes the run may end with; a negative one is a signal. blames: whom a run
    that failed must name: the participant that was `hit`, `nobody`, or `any`. when: the moments at
    which it may strike. endless: the run ends only by the fault; otherwise it must end by itself,
    and where its code is 0, with the recording of an undisturbed run. arguments, prepare: of
    `stepbus run`, and what happens before its start. environment: further variables of the run.
    stdout, stderr: where they go. takes_s: how long it takes until the fault strikes [s]. leaves:
    what may stay in the folder for temporary files, since no process is left to remove it. cases:
    how often it comes in a whole campaign.
    """

    strike: Strike | None = None
    codes: frozenset[int]
    blames: Literal["hit", "nobody", "any"] = "nobody"
    when: tuple[str, ...]
    endless: bool = True
    arguments: tuple[str, ...] = ()
    prepare: Prepare | None = None
    environment: Mapping[str, str] = field(default_factory=dict)
    stdout: str = "file"
    stderr: str = "file"
    takes_s: float = 0.0
    leaves: bool = False
    cases: int = 1


class Missed(Exception):
    """The run ended before the fault struck."""


def in_turn(*strikes: Strike) -> Strike:
    """Return a strike that is several, one after the other."""

    def strike(box: Sandbox, chance: random.Random) -> None:
        for one in strikes:
            one(box, chance)

    return strike


def one_of(box: Sandbox, options: Sequence[Any]) -> Any:
    """Return what this case does of several things: the cases of a fault take them in turn."""
    return options[box.notes["turn"] % len(options)]
