"""Runs in which a camera's images are drawn beside the steps."""

import psutil
import pytest
from support.services.camera import WORLD, write_scene
from support.surroundings import comes_true
from support.tools import needs_pybullet

from stepbus_orchestrator.analysis.verify import verify
from stepbus_orchestrator.recording.reader import Recording
from stepbus_orchestrator.replay.branch import branch
from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load
from stepbus_plant.engines import default_engine

FALLING = WORLD.replace("0.05], fixed_base: true", "0.4]")
PROGRAM = """
import os
import signal
from pathlib import Path

import psutil
import stepbus
from stepbus.messages import CameraTrigger


def words(process):
    # Others than the plants end meanwhile.
    try:
        return process.cmdline()
    except psutil.NoSuchProcess:
        return []


class Viewer(stepbus.Participant):
    def update(self, step):
        step.get("rgb")


class Disturber(stepbus.Participant):
    \"\"\"Asks for an image, and sends a signal to the process that draws it, or to its parent.\"\"\"

    def update(self, step):
        if step.index == 1:
            mine = psutil.Process()
            plants = [mine] if self.config.params["shared"] else mine.parent().children()
            (copy,) = [c for p in plants for c in p.children() if words(c) == words(p) != []]
            target, number = self.config.params["who"], self.config.params["signal"]
            Path(self.config.folder, "pid").write_text(str(copy.pid))
            os.kill(copy.ppid() if target == "plant" else copy.pid, number)
        return {"camera": CameraTrigger(id=0)}
"""
SCENARIO = """
name: late
step: 5ms
duration: 75ms
participants:
  plant:
    participant: stepbus_plant:Plant
    publishes: first
    params: {world: world.yaml, engine: ENGINE}
    outputs:
      joint_state: JointState/1
      rgb: {type: Image/1, bulk: true}
      depth: {type: Image/1, bulk: true}
"""
VIEWER = """
  viewer:
    participant: program.py:Viewer
    inputs: {rgb: plant.rgb}
"""
DISTURBER = """
    inputs: {camera: disturber.camera}
  disturber:
    participant: program.py:Disturber
    inputs: {joint_state: plant.joint_state}
    outputs: {camera: CameraTrigger/1}
    params: {who: WHO, signal: NUMBER, shared: SHARED}
"""


def write(folder, camera, rest=VIEWER, engine=None):
    """Return a scenario; engine: of the plant, by default that of this machine."""
    write_scene(folder, FALLING.replace("period: 10ms", camera))
    (folder / "program.py").write_text(PROGRAM)
    text = SCENARIO.replace("ENGINE", engine or default_engine())
    (folder / "scenario.yaml").write_text(text + rest)
    return load(str(folder / "scenario.yaml"))


def disturber(who, number, *, shared):
    text = DISTURBER.replace("WHO", who).replace("NUMBER", str(number))
    return text.replace("SHARED", str(shared).lower())


def run_in(folder, scenario, *, in_process=False):
    return run(scenario, Options(out=folder, host=host_of(in_process=in_process)))


def images(result):
    """Return (step, bytes) of each image, by its port."""
    with Recording(result.recording) as recording:
        return {
            port: [(row.step, row.data) for row in recording[f"plant.{port}"].entries()]
            for port in ("rgb", "depth")
        }


@pytest.mark.parametrize("in_process", [False, True])
def test_a_run_with_a_latency_has_the_images_of_one_without_later(tmp_path, in_process):
    now = run_in(tmp_path / "now", write(tmp_path, "period: 10ms"), in_process=in_process)
    late = write(tmp_path, "period: 10ms, latency: 15ms")
    seen, after = images(now), images(run_in(tmp_path / "late", late, in_process=in_process))
    for port, rows in seen.items():
        assert [(step + 3, data) for step, data in rows if step + 3 <= 15] == after[port]
        assert len({data for _, data in rows}) > 3


@pytest.mark.slow
def test_a_run_with_images_under_way_is_verified_and_branched(tmp_path):
    scenario = write(tmp_path, "period: 5ms, latency: 20ms")
    verified = verify(scenario, runs=2, out=tmp_path / "runs")
    assert (verified.failed, verified.different) == (None, None)
    recorded = run_in(tmp_path / "run", scenario).recording
    found = branch(recorded, tmp_path / "branch", at=6)
    assert found.result.exit_code == 0
    assert found.result.recording.read_bytes() == recorded.read_bytes()


@needs_pybullet
@pytest.mark.parametrize(
    ("number", "text", "in_process"),
    [
        (9, "computed it, was killed by SIGKILL", False),
        (9, "computed it, was killed by SIGKILL", True),
        pytest.param(19, "", False, marks=pytest.mark.slow),
        pytest.param(19, "", True, marks=pytest.mark.slow),
    ],
)
def test_a_copy_that_is_killed_or_stopped_ends_the_run_with_one_sentence(
    tmp_path, number, text, in_process
):
    rest = disturber("copy", number, shared=in_process)
    size = "latency: 25ms, width: 3000, height: 3000"
    scenario = write(tmp_path, size, rest, engine="pybullet")
    result = run_in(tmp_path / "run", scenario, in_process=in_process)
    pid = (tmp_path / "pid").read_text()
    assert (result.participant, result.at_step) == ("plant", 6)
    image = f"camera 'wrist', image of 0.005 s: process {pid}, which {text}"
    assert (image if text else "deadline 3 s") in result.reason
    assert not psutil.pid_exists(int(pid))


@needs_pybullet
def test_a_copy_ends_with_its_plant(tmp_path):
    rest = disturber("plant", 9, shared=False)
    size = "latency: 25ms, width: 3000, height: 3000"
    result = run_in(tmp_path / "run", write(tmp_path, size, rest, engine="pybullet"))
    assert (result.participant, result.exit_code) == ("plant", 5)
    pid = int((tmp_path / "pid").read_text())
    assert comes_true(lambda: not psutil.pid_exists(pid))
