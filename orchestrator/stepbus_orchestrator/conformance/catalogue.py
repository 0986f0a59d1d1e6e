"""All checks, in the order they are run."""

from __future__ import annotations

from collections.abc import Sequence

from stepbus_participant import suggest
from stepbus_schemas import WiringError

from . import (
    checks_faults,
    checks_forms,
    checks_inputs,
    checks_join,
    checks_noise,
    checks_ready,
    checks_steps,
    checks_stop,
)
from .check import Check

CHECKS: tuple[Check, ...] = (
    *checks_join.CHECKS,
    *checks_ready.CHECKS,
    *checks_steps.CHECKS,
    *checks_inputs.CHECKS,
    *checks_forms.CHECKS,
    *checks_noise.CHECKS,
    *checks_faults.CHECKS,
    *checks_stop.CHECKS,
)


def select(names: Sequence[str]) -> tuple[Check, ...]:
    """Return the checks of these names, in their own order; all where there are none.

    Raises WiringError for a name that is no check's.
    """
    known = [check.name for check in CHECKS]
    for name in names:
        if name not in known:
            raise WiringError(f"no check {name!r}{suggest(name, known)}")
    return tuple(check for check in CHECKS if not names or check.name in names)
