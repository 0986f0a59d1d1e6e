"""How far a run may go: as far as the barrier and every gate let it."""

from collections.abc import Iterable
from typing import Protocol

from .barrier import Barrier

FAR = 1 << 62
"""Beyond the last step of any run."""


class Gate(Protocol):
    """Holds a run before a step: a pause, an injected fault, a call."""

    def limit(self, released: int) -> int:
        """Return the first step that must not be released yet; FAR: none.

        released: steps below it have been released. Called again and again.
        """


def step_limit(barrier: Barrier, gates: Iterable[Gate], released: int) -> int:
    """Return how far participants may work; the trigger only ever grows (P5.2)."""
    limit = min([barrier.step_limit, *(gate.limit(released) for gate in gates)])
    return max(limit, released)
