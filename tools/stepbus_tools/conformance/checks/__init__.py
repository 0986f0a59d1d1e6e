"""The checks, by the part of docs/protocol.md that they check, in the order they run."""

from collections.abc import Sequence

from stepbus_participant import suggest
from stepbus_schemas import WiringError
from stepbus_tools.conformance.check import Check

from . import admission, encodings, endings, inputs, noise, steps

CHECKS = tuple(
    item
    for module in (admission, steps, inputs, encodings, noise, endings)
    for item in vars(module).values()
    if isinstance(item, Check)
)


def select(names: Sequence[str]) -> tuple[Check, ...]:
    """Return the checks of these names, in the order they run; without names, all.

    Raises WiringError for an unknown name.
    """
    known = [check.name for check in CHECKS]
    for name in names:
        if name not in known:
            raise WiringError(f"no check {name!r}{suggest(name, known)}")
    return tuple(check for check in CHECKS if not names or check.name in names)
