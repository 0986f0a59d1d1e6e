"""The same fault on real processes: what `stepbus run --fault` or a shell does."""

from collections.abc import Iterator

from stepbus_participant import format_duration

from .execution import Execution
from .kinds import KINDS
from .tape import Fault


def real_fault(execution: Execution, fault: Fault) -> str:
    """Return what strikes real processes like a fault of a tape; empty where nothing does."""
    # `corrupt` damages the first byte.
    if fault.kind == "garbage" and fault.amount:
        return ""
    template = KINDS[fault.kind].real
    return template.format(
        target=fault.target,
        struck=execution.struck_at.get(fault, 0),
        step=fault.at - fault.at % execution.every(fault.target) if "{step}" in template else 0,
        lasting=f" for {format_duration(fault.amount)}" if fault.amount > 0 else "",
        s=fault.amount / 1e9,
    )


def commands(execution: Execution) -> Iterator[str]:
    """Yield what strikes real processes as the faults that took effect, as far as it can be had."""
    for fault in execution.effective:
        if text := real_fault(execution, fault):
            yield text
