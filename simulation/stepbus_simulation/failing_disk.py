"""How the disk of a simulated run fails."""

import os
from collections.abc import Callable

from .execution import Execution
from .strikes import Arm
from .tape import Fault


def _disk(
    execution: Execution, fault: Fault, strike: Callable[[int, str, int], int], count: int
) -> None:
    """Let calls number `at` to `at + count` of the disk go wrong; target: the name of the call."""
    before, calls = execution.disk.strike, 0

    def struck(name: str, size: int) -> int:
        nonlocal calls
        size = before(name, size)
        if fault.target in {"", name}:
            calls += 1
            if 0 <= calls - 1 - fault.at < count:
                execution.struck(fault)
                return strike(calls, name, size)
        return size

    execution.disk.strike = struck


def raising(number: int, count: int | None) -> Arm:
    """Return what lets calls of the disk fail."""

    def strike(_number: int, _name: str, _size: int) -> int:
        raise OSError(number, os.strerror(number))

    def arm(execution: Execution, fault: Fault) -> None:
        _disk(execution, fault, strike, fault.amount if count is None else count)

    return arm


def short(execution: Execution, fault: Fault) -> None:
    """Let a write take only a part."""
    _disk(execution, fault, lambda _n, _name, size: min(size, max(1, fault.amount)), 1)


def power(execution: Execution, fault: Fault) -> None:
    """Let the machine lose its power: what is being written is torn, what is renamed is not."""

    def strike(_number: int, name: str, size: int) -> int:
        if name == "replace":
            execution.orchestrator.kill()
        return size * fault.amount // 1000

    def done(_name: str) -> None:
        if fault in execution.effective:
            execution.orchestrator.kill()

    _disk(execution, fault, strike, 1)
    execution.disk.done = done
