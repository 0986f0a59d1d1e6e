"""The nearest name to one that nobody knows."""

import difflib
from collections.abc import Iterable


def suggest(name: object, known: Iterable[object]) -> str:
    """Return `; did you mean 'x'?`, or the known names where none is near."""
    names = list(dict.fromkeys(str(item) for item in known))
    near = difflib.get_close_matches(str(name), names, n=1)
    if near:
        return f"; did you mean {near[0]!r}?"
    return f"; known: {', '.join(names)}" if names else ""
