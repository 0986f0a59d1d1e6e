"""The controllers in Octave and Java, through the bridge: in one process, and on the bus."""

import numpy as np
import pytest
from support.paths import CHECKOUT
from support.tools import needs

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_tools.signals import read_tracking

EXAMPLES = CHECKOUT / "examples" / "controllers"
PROGRAMS = {"octave": "octave-cli", "java": "javac"}
"""`java` alone, without a JDK, compiles no source."""


@pytest.fixture(scope="module", params=PROGRAMS)
def result(request, tmp_path_factory):
    """Return the result of a second of the example in one language."""
    needs(PROGRAMS[request.param])
    scenario = load(EXAMPLES / request.param, ["duration=1s"])
    out = tmp_path_factory.mktemp(request.param) / "out"
    return run(scenario, Options(out=out))


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """Return the result of a second of the built-in PD controller."""
    out = tmp_path_factory.mktemp("python") / "out"
    return run(load("two_link/pd", ["duration=1s"]), Options(out=out, host=InProcess()))


def trajectory(result):
    """Return the positions of both joints, shape (steps + 1, 2), [rad]."""
    return read_tracking(Recording(result.recording)).state_of("joint1").fields["position"]


def test_it_moves_the_arm_as_the_python_controller_does(result, python):
    assert (result.exit_code, trajectory(result).shape) == (0, (201, 2))
    assert np.abs(trajectory(result) - trajectory(python)).max() <= 1e-9


def test_it_drops_nothing(result):
    assert result.drops == {"plant": 0, "controller": 0, "mission": 0}


@pytest.mark.slow
def test_its_recording_runs_again_from_itself(result, tmp_path, capsys):
    assert main(["rerun", str(result.recording), "--out", str(tmp_path / "again")]) == 0
    assert "byte for byte as recorded" in capsys.readouterr().out
