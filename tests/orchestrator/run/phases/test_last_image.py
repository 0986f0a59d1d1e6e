"""An image at the last step is recorded, and the log behind it is not lost."""

import pytest

from stepbus_orchestrator.recording.reader import Recording
from stepbus_orchestrator.run.run_scenario import Options, host_of
from stepbus_orchestrator.run.run_scenario import run as run_scenario
from stepbus_orchestrator.scenario.load import load

STEPS = 3
BYTES = 6_000_000
PROGRAM = f"""
import stepbus
from stepbus_schemas import Description, Image


class Viewer(stepbus.Participant):
    def update(self, step):
        step.read("image")


class Camera(stepbus.Participant):
    def describe(self):
        return {{"image": Description(names=["camera"])}}

    def output(self, step):
        pixels = bytes({BYTES})
        return {{"image": Image(width={BYTES // 3}, height=1, encoding="rgb8", data=pixels,
                               focal=(1.0, 1.0), centre=(0.0, 0.0))}}
"""
SCENARIO = f"""
name: last_image
step: 5ms
duration: {STEPS * 5}ms
participants:
  camera:
    participant: camera.py:Camera
    publishes: first
    stop_timeout: 60s
    outputs: {{image: {{type: Image/1, bulk: true}}}}
  viewer:
    participant: camera.py:Viewer
    stop_timeout: 60s
    inputs: {{image: camera.image}}
"""


@pytest.mark.parametrize("in_process", [False, True])
def test_an_image_at_the_last_step_is_recorded(tmp_path, in_process):
    (tmp_path / "camera.py").write_text(PROGRAM)
    path = tmp_path / "scenario.yaml"
    path.write_text(SCENARIO)
    result = run_scenario(
        load(str(path)), Options(out=tmp_path / "run", host=host_of(in_process=in_process))
    )
    assert (result.exit_code, result.reason) == (0, "finished")
    with Recording(result.recording) as recording:
        assert len(recording["camera.image"]) == STEPS + 1
