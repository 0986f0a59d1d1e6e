"""A file that nothing names is recorded where it is declared."""

import pytest
from support.runs.joints import write_scenario

from stepbus_orchestrator.replay.rerun import Preparation
from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load


@pytest.fixture
def reading(tmp_path):
    """Return a scenario whose controller reads a file that nothing names."""
    path = write_scenario(tmp_path / "source")
    program = path.with_name("joints.py")
    old = '"""Proportional;'
    text = program.read_text()
    assert old in text
    program.write_text(
        text.replace("ROLE, FAULT", 'open("gains" + ".dat").close()\nROLE, FAULT', 1)
    )
    for name in ("gains.dat", "unread.dat"):
        path.with_name(name).write_text("1")
    return path


def run_it(path, out, *, in_process=False):
    options = Options(out=out, host=host_of(in_process=in_process))
    return run(load(path, ["duration=50ms"]), options)


def test_a_declared_file_is_recorded_and_found_again(reading, tmp_path):
    text = reading.read_text()
    reading.write_text(text.replace("Controller\n", "Controller\n    files: ['*.dat']\n", 1))
    result = run_it(reading, tmp_path / "run", in_process=True)
    assert not result.warnings
    assert Preparation(result.recording, tmp_path / "again").run().equal
