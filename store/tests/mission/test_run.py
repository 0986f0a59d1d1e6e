"""The mission of the store as a process: its sentence is the reason of the run."""

import json

import msgpack
import pytest
from support.messages.recordings import messages
from support.store_paths import STORE_PROGRAMS, STORE_TESTS

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

pytestmark = pytest.mark.slow

SCENARIO = """
name: sales
step: 20ms
duration: 60s
participants:
  plant:
    participant: fake_store.py:Store
    params: {{faults: {faults}}}
    publishes: first
    spawn_timeout: 60s
    inputs: {{goal: mission.goal}}
    outputs:
      poses: Poses/1
      gripper: GripperState/1
      odometry: BaseState/1
      detections: Detections/1
      goal_status: GoalStatus/1
  mission:
    participant: stepbus_store.mission:StoreMission
    spawn_timeout: 60s
    inputs:
      poses: plant.poses
      gripper: plant.gripper
      odometry: plant.odometry
      detections: plant.detections
      goal_status: plant.goal_status
    outputs: {{goal: Goal/1, events: Event/1, summary: Event/1}}
    params:
      orders: [cola, water]
      shelves: {{a: {{front: [1.95, 0.0], yaw: 0.0}}}}
      outlet: {{position: [0.15, 0.65, 0.35]}}
      tuck: {{elbow_joint: 2.0}}
"""


def sales(folder, **faults):
    folder.mkdir()
    path = folder / "scenario.yaml"
    program = (STORE_PROGRAMS / "fake_store.py").read_text()
    (folder / "fake_store.py").write_text(program.replace("TESTS", str(STORE_TESTS)))
    path.write_text(SCENARIO.format(faults=json.dumps(faults)))
    return run(load(path), Options(out=folder / "out", host=InProcess()))


def told(result, port):
    rows = [data for topic, _, _, data in messages(result.recording) if topic == f"mission/{port}"]
    return [msgpack.unpackb(row)["text"] for row in rows]


def test_all_orders_are_sold_and_a_second_run_is_the_same_to_the_byte(tmp_path):
    results = [sales(tmp_path / name, noise=0.003) for name in ("one", "other")]
    assert [result.exit_code for result in results] == [ExitCode.FINISHED] * 2, results[0].reason
    assert "mission: 2 of 2 sales are done" in results[0].reason
    assert results[0].sha256 == results[1].sha256


def test_the_sentence_of_a_failed_sale_is_the_reason_and_the_last_event(tmp_path):
    result = sales(tmp_path / "one", slips=9)
    sentence = (
        "sale 1 (cola_a1_2) failed while lifting: slipped, width 0.000 m, after 2 attempts; "
        "everything is at rest"
    )
    assert (result.exit_code, result.participant) == (ExitCode.FAULT, "mission")
    assert sentence in result.reason
    assert told(result, "events")[-1] == sentence
    assert told(result, "summary")[-1].endswith(sentence)
