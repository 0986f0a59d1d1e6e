"""Who may publish many steps in one message (P7.6)."""

from types import SimpleNamespace

import pytest
from msgspec import structs
from support.runs.kernel import CONTROLLER, PLANT, participant, scenario

from stepbus_orchestrator.run.kernel.admission import batches_of
from stepbus_orchestrator.scenario.model import FaultSpec, HoldSpec
from stepbus_orchestrator.scenario.ports import OutputSpec

MISSION = participant("mission")
BULK = OutputSpec(type="Image/1", bulk=True)
ALL = {"plant": True, "mission": True, "controller": True}


def allowed(mission=MISSION, takes=ALL, **options):
    participants = {name: SimpleNamespace(takes_batches=is_able) for name, is_able in takes.items()}
    return batches_of(scenario(PLANT, mission, CONTROLLER, **options), participants)


@pytest.mark.parametrize(
    ("options", "most"),
    [
        ({}, {"mission": 32}),
        ({"mission": participant("mission", every=4)}, {"mission": 8}),
        ({"window": 1, "batch": 1}, {}),
        ({"takes": ALL | {"controller": False}}, {}),
        ({"takes": {"mission": True}}, {}),
        ({"mission": participant("mission", on_fault=HoldSpec())}, {}),
        ({"mission": structs.replace(MISSION, outputs=MISSION.outputs | {"image": BULK})}, {}),
        ({"faults": (FaultSpec(type="drop", participant="mission", step=3),)}, {}),
    ],
    ids=["alone", "rare", "one step", "old consumer", "played", "held", "bulk", "faults"],
)
def test_one_without_inputs_may_where_all_its_readers_can_take_it(options, most):
    assert allowed(**options) == most
