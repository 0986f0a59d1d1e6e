"""A participant with the names of protocol 1 and the number 2 is reported with what it lacks."""

import re

import pytest
from support.paths import PROGRAMS
from support.runs.joints import run_joints

from stepbus_orchestrator.errors import ExitCode

pytestmark = pytest.mark.usefixtures("nothing_is_left")


def run_page_before(folder):
    source = folder / "source"
    source.mkdir()
    for name in ("by_the_page.py", "page_before.py"):
        (source / name).write_bytes((PROGRAMS / name).read_bytes())
    program = "controller.exec=[python, page_before.py]"
    return run_joints(folder, program, "controller.step_timeout=1s", "controller.stop_timeout=1s")


def test_a_participant_that_drops_its_triggers_is_said_to_wait_for_them(tmp_path):
    result = run_page_before(tmp_path)
    assert (result.exit_code, result.participant) == (ExitCode.STEP_TIMEOUT, "controller")
    sentence = (
        r"step 0 .*: controller \(pid \d+\) has held the step for \d+\.\d s: it reports that it is waiting "
        r"for the trigger of step 0, which was sent, and [1-9]\d* dropped messages? "
        r"\([1-9]\d* unauthenticated\); does it read `step_limit`"
    )
    assert re.search(sentence, result.reason), result.reason
