"""Starts participants of a run from outside, as somebody in another terminal would."""

import os
import subprocess
import sys
import threading
from pathlib import Path

from support.runs.joints import write_scenario

from stepbus_orchestrator.run.extensions.debug import Debug
from stepbus_orchestrator.run.extensions.external import External
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.extensions.real_time import RealTime
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

JOIN = (sys.executable, "-m", "stepbus_orchestrator.cli", "join")
QUIET = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
SHORT = ("window=2", "batch=1", "duration=500ms")


class Elsewhere:
    """Processes that a test starts beside the run, and ends with itself."""

    def __init__(self):
        self.processes = []

    def start(self, *command, **options):
        """Start a command in a session of its own; return its process."""
        options = {"text": True, "start_new_session": True, **QUIET, **options}
        process = subprocess.Popen([str(word) for word in command], **options)
        self.processes.append(process)
        return process

    def join(self, ticket, *words, **options):
        """Start `stepbus join`; words: its further arguments."""
        return self.start(*JOIN, ticket, *words, **options)

    def wait_until_it_waits(self, process):
        """Return what it prints until it waits for its run."""
        line = process.stderr.readline()
        assert "waiting" in line, line
        return line

    def close(self):
        """End all that is left."""
        for process in self.processes:
            if process.poll() is None:
                os.killpg(process.pid, 18)
                os.killpg(process.pid, 9)
            process.wait(20)
            for stream in (process.stdin, process.stdout, process.stderr):
                if stream is not None:
                    stream.close()


class Watcher(Observer):
    """Keeps what a run tells, and acts when it has come to its pause, or waits for somebody.

    invited: is called with nothing when the run says whom it waits for, with `words` in it. paused:
    in the pause, which it ends.
    """

    def __init__(self, pace=None, invited=None, paused=None, words=""):
        self.pace, self._invited, self._paused, self._words = pace, invited, paused, words
        self.told = []

    def event(self, level, who, step, text):
        self.told.append(f"{level}: {who}: {text}")
        if level == "waiting" and self._invited is not None and self._words in text:
            invited, self._invited = self._invited, None
            invited()

    def progress(self, progress):
        if progress.phase == "paused" and self._paused is not None:
            paused, self._paused = self._paused, None
            paused()
            self.pace.resume()


def run_with_external(
    folder: Path, *overrides, names=("controller",), invited=None, paused=None, interrupt=None,
    no_deadline=(), tickets=None, words="", real_time=None,
):  # fmt: skip
    """Return the result of a run of which some participants are started by somebody else, and what it told.

    invited, paused: as of the Watcher; the run is paused before step 30 where there is `paused`.
    """
    external = [f"{name}.start=external" for name in names]
    scenario = load(write_scenario(folder / "source"), [*SHORT, *external, *overrides])
    pace = Pace(at=30) if paused else None
    watcher = Watcher(pace, invited, paused, words)
    options = Options(
        out=folder / "out",
        extensions=[
            External(tickets or {}),
            Debug(no_deadline=no_deadline),
            *([pace] if pace else []),
            *([RealTime(scenario.step_ns, real_time)] if real_time else []),
        ],
    )
    return run(scenario, options, watcher, interrupt or threading.Event()), watcher.told
