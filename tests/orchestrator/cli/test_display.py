"""What a display prints goes to the terminal, whatever becomes of `sys.stdout` meanwhile."""

import io
import sys

import pytest

from stepbus_orchestrator.cli.live import displayed


@pytest.mark.parametrize("quiet", [False, True])
def test_a_sentence_goes_where_the_display_was_opened(monkeypatch, quiet):
    terminal, elsewhere = io.StringIO(), io.StringIO()
    stream = "stderr" if quiet else "stdout"
    monkeypatch.setattr(sys, stream, terminal)
    with displayed("test", quiet=quiet, invites=True) as display:
        # As a run in one process does while a participant has its turn.
        monkeypatch.setattr(sys, stream, elsewhere)
        display.event("warning", "plant", 3, "too warm")
    assert (terminal.getvalue(), elsewhere.getvalue()) == (
        "warning: plant at step 3: too warm\n",
        "",
    )
