"""Runs in which images arrive with a latency."""

import pytest
from support.services.camera import WORLD, write_scene

from stepbus_orchestrator.analysis.verify import verify
from stepbus_orchestrator.recording.reader import Recording
from stepbus_orchestrator.replay.branch import branch
from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load

FALLING = WORLD.replace("0.05], fixed_base: true", "0.4]")
PROGRAM = """
import stepbus


class Viewer(stepbus.Participant):
    def update(self, step):
        step.get("rgb")
"""
SCENARIO = """
name: late
step: 5ms
duration: 75ms
participants:
  plant:
    participant: stepbus_plant:Plant
    publishes: first
    params: {world: world.yaml}
    outputs:
      joint_state: JointState/1
      rgb: {type: Image/1, bulk: true}
      depth: {type: Image/1, bulk: true}
  viewer:
    participant: program.py:Viewer
    inputs: {rgb: plant.rgb}
"""


def write(folder, camera):
    """Return a scenario."""
    write_scene(folder, FALLING.replace("period: 10ms", camera))
    (folder / "program.py").write_text(PROGRAM)
    (folder / "scenario.yaml").write_text(SCENARIO)
    return load(str(folder / "scenario.yaml"))


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
