"""The same fault on real processes: what `stepbus run --fault` or a shell does."""

from collections.abc import Iterator

from stepbus_participant import format_duration

from .execution import Execution
from .tape import Fault

_MESSAGES = {"never": "drop", "twice": "duplicate", "garbage": "corrupt"}
_SHELL = {
    "folder": "rm -r RUN  # while it runs",
    "interrupt": "kill -INT ORCHESTRATOR",
    "crash": "kill -KILL ORCHESTRATOR",
    "suspend": "kill -STOP ORCHESTRATOR; sleep {s}; kill -CONT ORCHESTRATOR",
    "full": "stepbus run … --out on a disk that becomes full: mount -t tmpfs -o size=1m none DIR",
    "full_once": "fill the disk of --out for a moment: fallocate -l SIZE DIR/x; rm DIR/x",
}


def real_fault(execution: Execution, fault: Fault) -> str:
    """Return the text of `--fault` that strikes like a fault of a tape; empty where none does."""
    step = execution.struck_at.get(fault, 0)
    lasting = f" for {format_duration(fault.amount)}" if fault.amount else ""
    if fault.kind == "kill":
        return f"kill {fault.target} at {step}"
    if fault.kind == "freeze":
        return f"freeze {fault.target} at {step}{lasting}"
    # `corrupt` damages the first byte.
    if fault.kind in _MESSAGES and not (fault.kind == "garbage" and fault.amount):
        step = fault.at - fault.at % execution.every(fault.target)
        return f"{_MESSAGES[fault.kind]} {fault.target} at {step}"
    return ""


def commands(execution: Execution) -> Iterator[str]:
    """Yield what strikes real processes as the faults that took effect, as far as it can be had."""
    for fault in execution.effective:
        if text := real_fault(execution, fault):
            yield f"--fault '{text}'"
        elif fault.kind in _SHELL:
            yield _SHELL[fault.kind].format(s=fault.amount / 1e9)
