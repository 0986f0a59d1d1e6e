"""Fixtures that several test files share."""

import pytest

from stepbus_orchestrator import Options, load, run


@pytest.fixture(scope="session")
def two_link_recording(tmp_path_factory):
    """Return run.mcap of 0.3 s of two_link, with its run's folder around it; do not change it."""
    out = tmp_path_factory.mktemp("two_link") / "run"
    result = run(load("two_link", ["duration=300ms"]), Options(out=out))
    assert result.exit_code == 0, result.reason
    return result.recording
