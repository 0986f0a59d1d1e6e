"""A pytest plugin: recorded logs as tests, in three lines (docs/guide/testing/replay.md).

It is loaded with every pytest of an environment that has stepbus, so it imports nothing of it
before a test asks for the fixture.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from stepbus.results import ReplayResult

MARKER = "stepbus_logs"
FIXTURE = "stepbus_replay"
_HELP = (
    f"{MARKER}(pattern, participant): run the test once for each log that matches a pattern such "
    f"as logs/*.mcap, relative to the test's file; the fixture {FIXTURE} replays the participant"
)


def pytest_configure(config: pytest.Config) -> None:
    """Declare the marker."""
    config.addinivalue_line("markers", _HELP)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that asks for the fixture once for each log of its marker."""
    if FIXTURE not in metafunc.fixturenames:
        return
    folder = metafunc.definition.path.parent
    marker = metafunc.definition.get_closest_marker(MARKER)
    logs = _logs(marker, folder)
    # A test that silently stops testing is worse than one that fails.
    cases: list[Any] = [logs] if isinstance(logs, str) else logs
    names = ["no log"]
    if not isinstance(logs, str):
        names = [log.relative_to(folder).as_posix() for log, _ in logs]
    metafunc.parametrize(FIXTURE, cases, indirect=True, ids=names)


def _logs(marker: pytest.Mark | None, folder: Path) -> list[tuple[Path, str]] | str:
    """Return the logs of a marker with their participant, or why there are none."""
    if marker is None:
        return (
            f"the fixture {FIXTURE} needs the marker, e.g. "
            f'@pytest.mark.{MARKER}("logs/*.mcap", participant="controller")'
        )
    match marker.args, marker.kwargs:
        case ((str(pattern), str(participant)), {**rest}) if not rest:
            pass
        case ((str(pattern),), {"participant": str(participant), **rest}) if not rest:
            pass
        case _:
            return f"write @pytest.mark.{MARKER}(pattern, participant=name), both as text"
    try:
        matches = sorted(folder.glob(pattern))
    except (NotImplementedError, ValueError):
        matches = []
    return [(path, participant) for path in matches] or f"no log matches {pattern!r} in {folder}"


@pytest.fixture
def stepbus_replay(request: pytest.FixtureRequest) -> Callable[..., ReplayResult]:
    """Return a function that replays the log of this test and fails where it is not equal.

    It tests the program in the work tree, where the log's scenario is found there, and warns where
    it is not; `source`: the scenario's folder, relative to the test's file; `recorded`: test the
    copy in the log; `tolerance`: a number, or a YAML file, relative to the test's file. All other
    options are those of `stepbus.replay`. It returns the result.
    """
    if isinstance(request.param, str):
        pytest.fail(request.param, pytrace=False)
    log, participant = request.param
    folder = request.path.parent

    def replay_log(**options: Any) -> ReplayResult:
        __tracebackhide__ = True
        for name in ("source", "tolerance"):
            if isinstance(path := options.get(name), str | PathLike):
                options[name] = folder / path
        testing: Any = import_module("stepbus.testing")
        result: ReplayResult = testing.assert_replays(log, participant, **options)
        for note in result.notes:
            warnings.warn(f"{log.name}: {note}", stacklevel=2)
        return result

    return replay_log
