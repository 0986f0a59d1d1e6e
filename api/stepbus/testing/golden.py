"""Golden logs: a recording as a test of one participant."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING

from stepbus_schemas import StepbusError

if TYPE_CHECKING:
    from stepbus.overrides import Overrides
    from stepbus.recordings import AnyTolerance, Source
    from stepbus_orchestrator import ReplayResult
    from stepbus_schemas import BridgeFormat


def assert_replays(
    recording: Source,
    participant: str,
    *,
    program: Sequence[str] | None = None,
    bridge: BridgeFormat | None = None,
    recorded: bool = False,
    source: str | PathLike[str] | None = None,
    set: Overrides = (),  # noqa: A002  as --set on the command line
    tolerance: AnyTolerance = None,
    update: str | PathLike[str] | None = None,
) -> ReplayResult:
    """Replay a participant and return the result; all arguments as of `stepbus.replay`.

    Raises AssertionError, with the first difference or what went wrong, when it is not equal.
    """
    from stepbus.recordings import path_of, replay  # noqa: PLC0415  they load the orchestrator

    __tracebackhide__ = True
    path = path_of(recording)
    try:
        result = replay(
            path,
            participant,
            program=program,
            bridge=bridge,
            recorded=recorded,
            source=source,
            set=set,
            tolerance=tolerance,
            update=update,
        )
    except StepbusError as exc:
        # Its sentence is complete; where it was raised is no line of the user's program.
        raise AssertionError(f"{path}: {exc}") from None
    if not result.equal:
        raise AssertionError(f"{path}: {result.text()}")
    return result
