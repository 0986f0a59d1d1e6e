"""Scenarios and recordings that name the store's participants as earlier versions did."""

import pytest

from stepbus_orchestrator.scenario.earlier import upgraded
from stepbus_participant import import_participant

EARLIER = {
    "stepbus_mission.store": "stepbus_store.mission:StoreMission",
    "stepbus_motion.arm": "stepbus_store.motion.arm:ArmController",
    "stepbus_motion.mobile": "stepbus_store.motion.mobile:MobileController",
    "stepbus_perception": "stepbus_store.perception:Perception",
    "stepbus_planner": "stepbus_store.planner:Planner",
    "stepbus_store.planner": "stepbus_store.planner:Planner",
    "stepbus_world_model": "stepbus_store.world_model:WorldModel",
}


@pytest.mark.parametrize(("module", "name"), EARLIER.items())
def test_a_program_of_an_earlier_version_is_the_class_of_today(tmp_path, module, name):
    row = {"exec": ["python", "-m", module], "every": 2}
    found = upgraded({"participants": {"one": row}})["participants"]["one"]
    assert found == {"participant": name, "every": 2}
    assert import_participant(name, tmp_path).__name__ == name.rpartition(":")[2]
