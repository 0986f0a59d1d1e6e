"""Whatever becomes of the reaper, a run ends and leaves nothing."""

import errno
import signal
import subprocess

from support.runs.joints import leftovers, run_joints
from support.surroundings import answers, living_children

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.processes import launcher
from stepbus_orchestrator.run.reports import Observer


def is_reaper(process):
    return "reaper.py" in " ".join(process.cmdline())


class SignalReaper(Observer):
    """Sends the run's reaper a signal as soon as the run makes progress."""

    def __init__(self, number):
        self._number = number
        self._before = living_children()
        self.reaper = None

    def progress(self, progress):
        if self.reaper is None:
            # Another test in this process may have left one that is still ending.
            found = answers(living_children() - self._before, is_reaper)
            (self.reaper,) = [child for child, is_one in found.items() if is_one]
            self.reaper.send_signal(self._number)


def test_a_reaper_that_cannot_be_started_ends_the_run_in_a_sentence(
    tmp_path, own_temp, monkeypatch
):
    def fail(*_args, **_options):
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(subprocess, "Popen", fail)
    result = run_joints(tmp_path)
    assert (result.exit_code, list(own_temp.iterdir())) == (ExitCode.START, [])
    assert "cannot start the reaper" in result.reason
    assert "Too many open files; check ulimit -n" in result.reason


def test_a_stopped_reaper_does_not_hang_the_end(tmp_path, own_temp, monkeypatch):
    monkeypatch.setattr(launcher, "_END_S", 1.0)
    watcher = SignalReaper(signal.SIGSTOP)
    result = run_joints(tmp_path, "duration=5s", observer=watcher)
    assert (result.exit_code, watcher.reaper is None) == (0, False)
    assert not watcher.reaper.is_running()
    assert (list(own_temp.iterdir()), leftovers(tmp_path)) == ([], [])


def test_a_killed_reaper_leaves_no_folder(tmp_path, own_temp):
    result = run_joints(tmp_path, "duration=5s", observer=SignalReaper(signal.SIGKILL))
    assert (result.exit_code, list(own_temp.iterdir())) == (0, [])
