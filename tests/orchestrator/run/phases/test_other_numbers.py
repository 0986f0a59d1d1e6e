"""Programs of other protocol numbers take part where a number is common, and are refused else (P14.1)."""

import re

import pytest
from support.paths import PROGRAMS
from support.runs.joints import run_joints

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording.reader import Recording

pytestmark = pytest.mark.usefixtures("nothing_is_left")


def run_with(folder, *arguments):
    source = folder / "source"
    source.mkdir(parents=True)
    for name in ("by_the_page.py", "other_numbers.py"):
        (source / name).write_bytes((PROGRAMS / name).read_bytes())
    command = ", ".join(["python", "other_numbers.py", *(f"'{it}'" for it in arguments)])
    return run_joints(folder, f"controller.exec=[{command}]", "duration=100ms")


def commands(result):
    with Recording(result.folder) as recording:
        return [entry.data for entry in recording["controller/command"].entries()]


def test_a_program_of_protocol_1_takes_part(tmp_path):
    result = run_with(tmp_path, 1, 1)
    assert (result.exit_code, result.steps, sum(result.drops.values())) == (0, 20, 0)


@pytest.mark.slow
def test_a_program_of_protocol_1_takes_part_with_the_same_result(tmp_path):
    results = [run_with(tmp_path / str(n), n, n) for n in (1, 2)]
    assert [(result.exit_code, result.steps) for result in results] == [(0, 20), (0, 20)]
    assert commands(results[0]) == commands(results[1])


@pytest.mark.slow
def test_a_program_without_a_common_number_is_refused_with_both_ranges(tmp_path):
    result = run_with(tmp_path, 3, 4)
    assert (result.exit_code, result.participant) == (ExitCode.START, "controller")
    sentence = (
        r"controller \(pid \d+\) was refused: controller speaks protocols 3 to 4, and this run "
        r"speaks protocols 1 to 2; update stepbus here \(docs/compatibility\.md\)"
    )
    assert re.search(sentence, result.reason), result.reason


@pytest.mark.slow
@pytest.mark.parametrize("numbers", [(2, 3), (1, 2), (1, 9), (0, 1)])
def test_a_program_of_a_range_takes_part_with_the_highest_common_number(tmp_path, numbers):
    assert run_with(tmp_path, *numbers).exit_code == 0


@pytest.mark.slow
def test_a_fault_of_a_program_of_protocol_1_ends_the_run_with_its_message(tmp_path):
    result = run_with(tmp_path, 1, 1, 5)
    assert (result.exit_code, result.participant) == (ExitCode.FAULT, "controller")
    assert re.search(r"step 5 .*controller .*too hot", result.reason)
