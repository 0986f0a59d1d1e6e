"""The planner over the real bus: the same run twice, in a narrow and a wide window."""

import textwrap
from pathlib import Path

import pytest
from mcap.reader import make_reader
from support.services.planner import write_arm

from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import Decoder, Plan

pytestmark = pytest.mark.slow

PROGRAM = """
from stepbus import Description, Participant
from stepbus.messages import PlanRequest, Poses


class Plant(Participant):
    def describe(self):
        details = {"shape": ["", "box 0.1 0.1 1 @ 0 0 0 0 0 0 1"], "body": ["robot", "pillar"]}
        return {"poses": Description(names=["chassis", "pillar"], details=details)}

    def output(self, step):
        at = [(0.0, 0.0, 0.0), (0.6, 0.001 * step.index, 0.5)]
        return {"poses": Poses(position=at, orientation=[(0.0, 0.0, 0.0, 1.0)] * 2)}


class Arm(Participant):
    def describe(self):
        return {"plan_request": Description(names=["one", "two", "three"])}

    def update(self, step):
        if step.index not in (3, 10, 60):
            return {}
        goal = [1.0, 0.1, -0.2]
        return {"plan_request": PlanRequest(id=step.index, start=[-1.0, 0.0, 0.0], goal=goal)}
"""

SCENARIO = """
name: around
step: 8ms
duration: 800ms
participants:
  plant:
    participant: peers.py:Plant
    publishes: first
    outputs: {poses: Poses/1}
  arm:
    participant: peers.py:Arm
    inputs: {plan: {from: planner.plan, delay: 1}}
    outputs: {plan_request: PlanRequest/1}
  planner:
    participant: stepbus_store.planner:Planner
    inputs: {request: arm.plan_request, poses: plant.poses}
    outputs: {plan: Plan/1, events: Event/1}
    params: {model: arm.urdf, joints: [one, two, three], tip: tip}
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("planner")
    write_arm(folder)
    (folder / "peers.py").write_text(PROGRAM)
    (folder / "scenario.yaml").write_text(textwrap.dedent(SCENARIO))
    return [
        run(load(folder / "scenario.yaml", overrides), Options(out=folder / overrides[0]))
        for overrides in (("window=1", "batch=1"), ("window=64",))
    ]


def test_a_run_with_a_planner_gives_the_same_bytes_in_any_window(runs):
    assert [result.reason for result in runs if result.exit_code] == []
    assert runs[0].sha256 == runs[1].sha256


def test_it_answers_200_ms_after_the_newest_request(runs):
    with Path(runs[0].folder, "run.mcap").open("rb") as file:
        found = [
            (message.log_time // 8_000_000, Decoder(Plan)(message.data))
            for _, channel, message in make_reader(file).iter_messages()
            if channel.topic.endswith("planner/plan")
        ]
    assert [(step, plan.id, plan.cause) for step, plan in found] == [(35, 10, ""), (85, 60, "")]
