"""How far a run may go: as far as the barrier and every gate let it."""

from collections.abc import Callable, Iterable

from .barrier import Barrier

FAR = 1 << 62
"""Beyond the last step of any run."""


Gate = Callable[[int], int]
"""Returns the first step that must not be released yet, or FAR; gets how far steps are released."""


def step_limit(barrier: Barrier, gates: Iterable[Gate], released: int) -> int:
    """Return how far participants may work; the trigger only ever grows (P5.2)."""
    limit = min([barrier.step_limit, *(gate(released) for gate in gates)])
    return max(limit, released)
