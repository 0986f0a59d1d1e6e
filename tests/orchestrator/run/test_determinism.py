"""The same scenario gives the same bytes, whatever the timing, the window or the transport."""

import os
import subprocess
import sys

import pytest
from support.runs.joints import run_joints, write_scenario

from stepbus_orchestrator.run.hosts import Processes
from stepbus_orchestrator.run.kernel.admission import participant_seed

OPTIONS = [("window=1", "batch=1"), ("bus.transport=tcp",)]
MORE = [
    ("window=2", "batch=1"),
    ("window=7", "batch=3"),
    ("window=64",),
    ("bus.low_latency=false",),
]


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    return run_joints(tmp_path_factory.mktemp("reference"), in_process=True)


@pytest.mark.parametrize(
    "overrides",
    [*OPTIONS, *(pytest.param(options, marks=pytest.mark.slow) for options in MORE)],
    ids="_".join,
)
def test_the_recording_does_not_depend_on_how_it_was_run(tmp_path, reference, overrides):
    result = run_joints(tmp_path, *overrides)
    assert (result.exit_code, result.sha256) == (0, reference.sha256)


@pytest.mark.parametrize(
    "order", [("mission", "controller", "plant"), ("controller", "plant", "mission")]
)
def test_the_recording_does_not_depend_on_the_start_order(tmp_path, reference, order):
    result = run_joints(tmp_path, host=Processes(start_order=order))
    assert (result.exit_code, result.sha256) == (0, reference.sha256)


def test_a_participant_that_ends_the_run_ends_it_at_the_same_step_in_any_window(tmp_path):
    end = "controller.params={fault: end, at: 41}"
    narrow = run_joints(tmp_path / "narrow", end, "window=1", "batch=1", in_process=True)
    wide = run_joints(tmp_path / "wide", end, "window=64")
    assert narrow.sha256 == wide.sha256


OWN = """
import msgspec
import stepbus

class Mood(stepbus.Message, frozen=True, kw_only=True):
    \"\"\"How a participant feels.\"\"\"

    TYPE = "Mood/1"
    level: float
"""


@pytest.mark.slow
def test_the_recording_does_not_depend_on_whether_python_checks_assertions(tmp_path):
    scenario = write_scenario(tmp_path / "source")
    (scenario.parent / "own.py").write_text(OWN)
    scenario.write_text(scenario.read_text() + "types: own\n")
    recorded = []
    for given in ("0", "1"):
        out = tmp_path / given
        words = ["run", scenario, "--in-process", "--no-report", "--set", "duration=50ms"]
        environment = {**os.environ, "PYTHONOPTIMIZE": given, "PYTHONPATH": str(scenario.parent)}
        command = [sys.executable, "-m", "stepbus_orchestrator.cli", *words, "--out", out]
        subprocess.run(command, env=environment, check=True, capture_output=True)
        recorded.append((out / "run.mcap").read_bytes())
    assert recorded[0] == recorded[1]


def test_the_seed_of_a_participant_is_published_arithmetic():
    """53 bits of the SHA-256 of `<seed of the run>/<name>`: old recordings are run again with it."""
    assert participant_seed(7, "mission") == 7906202399376919
