"""Fixtures that several test files share."""

import tempfile
from pathlib import Path

import pytest

from stepbus_orchestrator import Options, load, run


@pytest.fixture(scope="session")
def two_link_recording(tmp_path_factory):
    """Return run.mcap of 0.3 s of two_link, with its run's folder around it; do not change it."""
    out = tmp_path_factory.mktemp("two_link") / "run"
    result = run(load("two_link", ["duration=300ms"]), Options(out=out))
    assert result.exit_code == 0, result.reason
    return result.recording


@pytest.fixture
def own_temp(monkeypatch):
    """Return a folder for temporary files of this test and its processes, which must stay empty.

    Its path is short: that of a Unix socket holds at most 107 bytes.
    """
    with tempfile.TemporaryDirectory(prefix="sb-") as folder:
        monkeypatch.setattr(tempfile, "tempdir", folder)
        monkeypatch.setenv("TMPDIR", folder)
        yield Path(folder)
        monkeypatch.undo()
