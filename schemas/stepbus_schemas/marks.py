"""Marks in the code that some run has to reach: a simulation lists those that none has."""

_reached: set[str] = set()


def reached(mark: str) -> None:
    """Note that a run has come here; mark: what has happened, one sentence, once in the source."""
    _reached.add(mark)


def reached_marks() -> set[str]:
    """Return all marks that this process has reached."""
    return set(_reached)
