"""Recordings to plot."""

import pytest
from support.messages.recordings import write

from stepbus_orchestrator.recording import Recording


@pytest.fixture
def record(tmp_path):
    """Return a function that records ports: name → type, names, messages."""
    return lambda **ports: Recording(write(tmp_path / "run.mcap", **ports))
