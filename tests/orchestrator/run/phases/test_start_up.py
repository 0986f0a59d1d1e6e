"""Start-up: who is to blame for a run that does not start."""

from support.runs.joints import write_scenario

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

LINGERS = """
import atexit
import time

# Runs after everything else: the bus is closed, its socket is gone, and the process is still there.
atexit.register(time.sleep, 0.5)

import stepbus

class Lingerer(stepbus.Participant):
    inputs = {"joint_state": "JointState/1", "reference": "JointState/1"}

stepbus.main(Lingerer)
"""


def test_who_is_refused_takes_its_own_socket_away(tmp_path):
    folder = tmp_path / "source"
    scenario = write_scenario(folder)
    (folder / "lingers.py").write_text(LINGERS)
    loaded = load(scenario, ["controller.exec=[python, lingers.py]"])
    result = run(loaded, Options(out=tmp_path / "out"))
    assert (result.exit_code, result.participant) == (ExitCode.START, "controller")
    assert "no longer exists" not in result.reason
