"""A bridged program keeps its process beside a run in one process."""

import re

import pytest
from support.runs.bridge import run_bridged
from support.surroundings import processes_in

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.hosts import InProcess

pytestmark = pytest.mark.usefixtures("starts_a_process")


@pytest.mark.parametrize("form", ["json", "raw"])
def test_a_bridged_program_keeps_its_process(tmp_path, separate, form):
    result = run_bridged(tmp_path, form, host=InProcess())
    assert result.exit_code == 0
    assert result.steps == 100
    with_processes = run_bridged(tmp_path / "separate", form)
    assert result.sha256 == with_processes.sha256


def test_a_bridged_program_that_does_not_answer_is_ended(tmp_path):
    result = run_bridged(tmp_path, "json", "hang", host=InProcess())
    assert (result.exit_code, result.participant) == (ExitCode.STEP_TIMEOUT, "controller")
    assert re.search(r"step 7 .* has waited \d+\.\d s for its program; deadline", result.reason)


def test_a_bridged_program_that_is_stopped_is_named_as_such(tmp_path):
    result = run_bridged(tmp_path, "json", "stop", host=InProcess())
    assert (result.exit_code, result.participant) == (ExitCode.STEP_TIMEOUT, "controller")
    assert "stopped by a signal or a debugger" in result.reason
    assert processes_in(tmp_path) == []
