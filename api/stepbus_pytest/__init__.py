"""A pytest plugin: recorded logs as tests, in three lines (docs/guide/replay.md).

It is loaded with every pytest of an environment that has stepbus, so it imports nothing of it
before a test asks for the fixture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from stepbus import ReplayResult
    from stepbus.overrides import Overrides
    from stepbus.recordings import AnyTolerance

MARKER = "stepbus_logs"
FIXTURE = "stepbus_replay"
_HELP = (
    f"{MARKER}(pattern, participant): run the test once for each log that matches a pattern such "
    f"as logs/*.mcap, relative to the test's file; the fixture {FIXTURE} replays the participant"
)


@dataclass(frozen=True, kw_only=True)
class _Log:
    """One log, and the participant to replay from it."""

    recording: Path
    participant: str


def pytest_configure(config: pytest.Config) -> None:
    """Declare the marker."""
    config.addinivalue_line("markers", _HELP)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that asks for the fixture once for each log of its marker."""
    if FIXTURE not in metafunc.fixturenames:
        return
    marker = metafunc.definition.get_closest_marker(MARKER)
    if marker is None:
        raise pytest.UsageError(
            f"{metafunc.definition.nodeid}: the fixture {FIXTURE} needs the marker, e.g. "
            f'@pytest.mark.{MARKER}("logs/*.mcap", participant="controller")'
        )
    folder = metafunc.definition.path.parent
    pattern, participant = _arguments(metafunc.definition.nodeid, *marker.args, **marker.kwargs)
    logs = _matching(folder, pattern)
    if not logs:
        # A test that silently stops testing is worse than one that fails.
        raise pytest.UsageError(
            f"{metafunc.definition.nodeid}: no log matches {pattern!r} in {folder}"
        )
    metafunc.parametrize(
        FIXTURE,
        [_Log(recording=path, participant=participant) for path in logs],
        indirect=True,
        ids=[path.relative_to(folder).as_posix() for path in logs],
    )


def _matching(folder: Path, pattern: str) -> list[Path]:
    try:
        return sorted(folder.glob(pattern))
    except (NotImplementedError, ValueError):
        return []


def _arguments(test: str, *args: Any, **kwargs: Any) -> tuple[str, str]:
    """Return the pattern and the participant of a marker."""
    match args, kwargs:
        case (str(pattern),), {"participant": str(participant), **rest} if not rest:
            return pattern, participant
        case (str(pattern), str(participant)), {**rest} if not rest:
            return pattern, participant
        case _:
            raise pytest.UsageError(
                f"{test}: write @pytest.mark.{MARKER}(pattern, participant=name), both as text"
            )


@pytest.fixture
def stepbus_replay(request: pytest.FixtureRequest) -> Callable[..., ReplayResult]:
    """Return a function that replays the log of this test and fails where it is not equal.

    It takes `program`: another program than the recorded one; `set`: overrides such as
    `{"controller.params.kp": 101}`; `tolerance`: a number, or a YAML file, relative to the test's
    file. It returns the result.
    """
    log: _Log = request.param
    folder = request.path.parent

    def replay_log(
        *,
        program: Sequence[str] | None = None,
        set: Overrides = (),  # noqa: A002  as --set on the command line
        tolerance: AnyTolerance = None,
    ) -> ReplayResult:
        __tracebackhide__ = True
        testing: Any = import_module("stepbus.testing")
        result: ReplayResult = testing.assert_replays(
            log.recording,
            log.participant,
            program=program,
            set=set,
            tolerance=folder / tolerance if isinstance(tolerance, str | PathLike) else tolerance,
        )
        return result

    return replay_log
