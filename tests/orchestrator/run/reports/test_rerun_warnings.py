"""A run warns where its recording cannot repeat it."""

import subprocess
import sys

import pytest
from support.runs.joints import write_scenario

from stepbus_orchestrator import Options, host_of, load
from stepbus_orchestrator.replay.rerun import Preparation
from stepbus_orchestrator.run.run_scenario import run
from stepbus_orchestrator.run.setup import opened_files
from stepbus_orchestrator.run.setup.opened_files import OpenedFiles


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


@pytest.fixture
def knows_readers(tmp_path):
    """Return whether this user is told who reads a file."""
    with OpenedFiles(tmp_path, tmp_path) as watch:
        return watch.knows_readers


@pytest.mark.parametrize("in_process", [False, True])
def test_a_file_that_is_read_and_not_recorded_is_named(
    reading, tmp_path, knows_readers, in_process
):
    result = run_it(reading, tmp_path / "run", in_process=in_process)
    (warned,) = result.warnings
    doubt = "" if knows_readers else ", if it is one of them that read it"
    assert (warned.source, warned.text) == (
        "recording",
        f"a rerun does not find gains.dat; declare it in `files` of its participant{doubt}",
    )


@pytest.mark.parametrize("in_process", [False, True])
def test_what_another_process_reads_meanwhile_is_not_named(
    reading, tmp_path, knows_readers, in_process
):
    if not knows_readers:
        pytest.skip("this user is not told who reads a file")
    path = reading.with_name("unread.dat")
    words = ["-c", f"while True: open({str(path)!r}).close()"]
    stranger = subprocess.Popen([sys.executable, *words], start_new_session=True)
    try:
        result = run_it(reading, tmp_path / "run", in_process=in_process)
    finally:
        stranger.kill()
        stranger.wait()
    (warned,) = result.warnings
    assert "gains.dat" in warned.text


def test_where_readers_are_not_known_the_warning_says_so(reading, tmp_path, monkeypatch):
    def refuse(_folders):
        raise PermissionError

    monkeypatch.setattr(opened_files, "_Readers", refuse)
    (warned,) = run_it(reading, tmp_path / "run", in_process=True).warnings
    assert warned.text.endswith("if it is one of them that read it")


def test_a_declared_file_is_recorded_and_found_again(reading, tmp_path):
    text = reading.read_text()
    reading.write_text(text.replace("Controller\n", "Controller\n    files: ['*.dat']\n", 1))
    result = run_it(reading, tmp_path / "run", in_process=True)
    assert not result.warnings
    assert Preparation(result.recording, tmp_path / "again").run().equal


def test_a_run_that_reads_what_is_recorded_warns_of_nothing(tmp_path):
    path = write_scenario(tmp_path / "source")
    path.with_name("unread.dat").write_text("1")
    assert not run_it(path, path.with_name("runs") / "one", in_process=True).warnings
