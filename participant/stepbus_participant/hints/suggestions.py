"""The nearest name to one that nobody knows."""

import difflib
from collections.abc import Iterable

_MOST_COMPARED, _MOST_SHOWN, _LONGEST = 1000, 40, 100


def suggest(name: object, known: Iterable[object]) -> str:
    """Return `; did you mean 'x'?`, or the known names where none is near."""
    names = list(dict.fromkeys(str(item) for item in known))
    # To compare takes time with the length of each, and with their number.
    short = [one for one in names[:_MOST_COMPARED] if len(one) <= _LONGEST]
    near = difflib.get_close_matches(str(name)[:_LONGEST], short, n=1)
    if near:
        return f"; did you mean {near[0]!r}?"
    shown = ", ".join(names[:_MOST_SHOWN])
    more = f" … ({len(names)} in all)" if len(names) > _MOST_SHOWN else ""
    return f"; known: {shown}{more}" if names else ""
