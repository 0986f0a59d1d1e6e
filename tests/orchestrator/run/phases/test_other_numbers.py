"""Programs of other protocol numbers take part where a number is common, and are refused else (P14.1)."""

import re

import pytest
from support.paths import PROGRAMS
from support.runs.joints import run_joints

from stepbus_orchestrator.errors import ExitCode

pytestmark = pytest.mark.usefixtures("nothing_is_left")


def run_with(folder, *arguments):
    source = folder / "source"
    source.mkdir(parents=True)
    for name in ("by_the_page.py", "other_numbers.py"):
        (source / name).write_bytes((PROGRAMS / name).read_bytes())
    command = ", ".join(["python", "other_numbers.py", *(f"'{it}'" for it in arguments)])
    return run_joints(folder, f"controller.exec=[{command}]", "duration=100ms")


@pytest.mark.slow
def test_a_program_without_a_common_number_is_refused_with_both_ranges(tmp_path):
    result = run_with(tmp_path, 3, 4)
    assert (result.exit_code, result.participant) == (ExitCode.START, "controller")
    sentence = (
        r"controller \(pid \d+\) was refused: controller speaks protocols 3 to 4, and this run "
        r"speaks protocol 2; update stepbus here \(docs/compatibility\.md\)"
    )
    assert re.search(sentence, result.reason), result.reason


@pytest.mark.slow
@pytest.mark.parametrize("numbers", [(2, 3), (1, 2), (1, 9)])
def test_a_program_of_a_range_takes_part_with_the_highest_common_number(tmp_path, numbers):
    assert run_with(tmp_path, *numbers).exit_code == 0
