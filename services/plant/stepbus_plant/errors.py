"""What can go wrong in the plant during a run; what is wrong before it is a WiringError.

RunError
├─ CommandError (ValueError)       a joint command that cannot be carried out
└─ PhysicsError (ArithmeticError)  the physics engine failed, or its state left the finite numbers
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from stepbus_schemas import RunError


class CommandError(RunError, ValueError):
    """A joint command that cannot be carried out."""


class PhysicsError(RunError, ArithmeticError):
    """The physics engine failed, or its state left the finite numbers."""


def hint(name: str, known: Iterable[str]) -> str:
    """Return the end of a sentence that names what `name` may have meant."""
    names = list(known)
    close = difflib.get_close_matches(name, names, n=3)
    if close:
        return "did you mean " + " or ".join(repr(item) for item in close) + "?"
    return "there is " + (", ".join(names) or "none")
