"""A participant that is written to the page of another protocol number is told so."""

import re

import pytest
from support.paths import PROGRAMS
from support.runs.joints import run_joints

from stepbus_orchestrator.errors import ExitCode

pytestmark = pytest.mark.usefixtures("nothing_is_left")


def run_page_before(folder, number):
    source = folder / "source"
    source.mkdir()
    for name in ("by_the_page.py", "page_before.py"):
        (source / name).write_bytes((PROGRAMS / name).read_bytes())
    program = f"controller.exec=[python, page_before.py, '{number}']"
    return run_joints(folder, program, "controller.step_timeout=1s", "controller.stop_timeout=1s")


def test_a_participant_of_protocol_1_is_refused_with_both_numbers_and_the_page(tmp_path):
    result = run_page_before(tmp_path, 1)
    assert (result.exit_code, result.participant) == (ExitCode.START, "controller")
    sentence = (
        r"controller \(pid \d+\) was refused: controller speaks protocol 1, but this run "
        r"speaks protocol 2; docs/protocol\.md lists the changes"
    )
    assert re.search(sentence, result.reason)


def test_a_participant_that_drops_its_triggers_is_said_to_wait_for_them(tmp_path):
    result = run_page_before(tmp_path, 2)
    assert (result.exit_code, result.participant) == (ExitCode.STEP_TIMEOUT, "controller")
    sentence = (
        r"step 0 .*: controller \(pid \d+\) has held the step for \d+\.\d s: it reports that it waits "
        r"for the trigger of step 0, which was sent, and [1-9]\d* dropped messages? "
        r"\([1-9]\d* unauthenticated\); does it read `step_limit`"
    )
    assert re.search(sentence, result.reason), result.reason
