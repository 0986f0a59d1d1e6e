"""Who may publish many steps in one message (P7.6)."""

from types import SimpleNamespace

from msgspec import structs
from support.runs.kernel import CONTROLLER, PLANT, participant, scenario

from stepbus_orchestrator.run.kernel.admission import batches_of
from stepbus_orchestrator.scenario.model import FaultSpec, HoldSpec
from stepbus_orchestrator.scenario.ports import OutputSpec

MISSION = participant("mission")
ALL = {"plant": True, "mission": True, "controller": True}


def allowed(mission=MISSION, takes=ALL, **options):
    participants = {name: SimpleNamespace(takes_batches=is_able) for name, is_able in takes.items()}
    return batches_of(scenario(PLANT, mission, CONTROLLER, **options), participants)


def test_a_participant_without_inputs_may_whose_consumers_can_take_it():
    assert allowed() == {"mission": 32}


def test_one_that_fires_less_often_publishes_as_many_as_its_log_holds():
    assert allowed(participant("mission", every=4)) == {"mission": 8}


def test_nobody_may_whose_logs_hold_one_step():
    assert allowed(window=1, batch=1) == {}


def test_a_consumer_that_cannot_take_it_keeps_all_by_themselves():
    assert allowed(takes=ALL | {"controller": False}) == {}


def test_a_consumer_that_is_played_keeps_all_by_themselves():
    assert allowed(takes={"mission": True}) == {}


def test_one_that_others_read_as_well_may_not():
    held = participant("mission", on_fault=HoldSpec())
    assert allowed(held) == {}
    outputs = MISSION.outputs | {"image": OutputSpec(type="Image/1", bulk=True)}
    assert allowed(structs.replace(MISSION, outputs=outputs)) == {}


def test_one_with_faults_in_its_messages_may_not():
    faults = (FaultSpec(type="drop", participant="mission", step=3),)
    assert allowed(faults=faults) == {}
