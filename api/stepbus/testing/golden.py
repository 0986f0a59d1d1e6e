"""Golden logs: a recording as a test of one participant."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from stepbus_schemas import StepbusError

if TYPE_CHECKING:
    from stepbus_orchestrator import ReplayResult, Source


def assert_replays(recording: Source, participant: str, **options: Any) -> ReplayResult:
    """Replay a participant and return the result; options: as of `stepbus.replay`.

    Raises AssertionError, with the first difference or what went wrong, when it is not equal.
    """
    from stepbus import replay  # noqa: PLC0415  it loads the orchestrator
    from stepbus_orchestrator import recording_file  # noqa: PLC0415

    __tracebackhide__ = True
    path = recording_file(recording)
    try:
        result = replay(path, participant, **options)
    except StepbusError as exc:
        # Its sentence is complete; where it was raised is no line of the user's program.
        raise AssertionError(f"{path}: {exc}") from None
    if not result.equal:
        raise AssertionError(f"{path}: {result.text()}")
    return result
