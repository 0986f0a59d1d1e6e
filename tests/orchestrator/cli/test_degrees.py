"""`stepbus run --degrees`: the angles of all joints, for who watches."""

import threading

from support.runs.joints import load, write_scenario

from stepbus_orchestrator.cli.terminal.live import in_degrees
from stepbus_orchestrator.recording.reader import Recording
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.run_scenario import Options, run


class Watcher(Observer):
    """Keeps the progress of a run at its pause, and ends it there."""

    def __init__(self):
        self.stop = threading.Event()

    def progress(self, progress):
        if progress.phase == "paused":
            self.angles, self.text = progress.angles, in_degrees(progress)
            self.stop.set()


def test_the_angles_are_those_that_were_measured_last(tmp_path):
    watcher = Watcher()
    options = Options(out=tmp_path / "out", extensions=[Pace(50)], host=InProcess())
    result = run(load(write_scenario(tmp_path / "source")), options, watcher, watcher.stop)
    measured = Recording(result.recording)["plant.joint_state"].position[49]
    assert watcher.angles == dict(zip(["hip", "knee"], measured, strict=True))
    assert watcher.text == "hip {:.1f}°, knee {:.1f}°".format(*(measured * 57.29577951308232))
