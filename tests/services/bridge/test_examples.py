"""The controllers in other languages do what the built-in one does, and replay from their log."""

import shutil
import subprocess

import numpy as np
import pytest
from support.paths import CHECKOUT
from support.tools import needs

from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay import replay
from stepbus_orchestrator.replay.rerun import Preparation
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_tools.signals import read_tracking

EXAMPLES = CHECKOUT / "examples/controllers"
TOOLS = {"c": ("cc", "make"), "javascript": ("node",)}
SHORT = ["duration=2s"]
PARTS = {"c": ["controller.c", "bridge.h", "Makefile"], "javascript": ["controller.mjs"]}


@pytest.fixture(scope="module")
def native(tmp_path_factory):
    out = tmp_path_factory.mktemp("pd") / "run"
    result = run(load("two_link/pd", SHORT), Options(out=out, host=InProcess()))
    assert result.exit_code == 0, result.reason
    return positions(result)


def positions(result):
    return read_tracking(Recording(result.recording)).state_of("joint1").fields["position"]


@pytest.fixture(scope="module", params=TOOLS)
def example(request, tmp_path_factory):
    """Return the result of a run of an example, copied and built elsewhere."""
    needs(*TOOLS[request.param])
    folder = tmp_path_factory.mktemp(request.param)
    for name in ("scenario.yaml", *PARTS[request.param]):
        shutil.copy(EXAMPLES / request.param / name, folder)
    if request.param == "c":
        subprocess.run(["make", "-s", "-C", folder], check=True, timeout=60)
    return run(load(folder, SHORT), Options(out=folder / "run"))


def test_its_joints_follow_those_under_the_built_in_controller(example, native):
    assert (example.exit_code, example.steps) == (0, 400), example.reason
    assert np.abs(positions(example) - native).max() <= 1e-9


@pytest.mark.slow
def test_it_is_replayed_and_run_again_from_its_recording(example, tmp_path):
    assert example.exit_code == 0, example.reason
    assert Preparation(example.recording, tmp_path / "again").run().equal
    assert replay(example.recording, "controller").equal
