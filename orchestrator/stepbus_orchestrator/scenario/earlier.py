"""Participants of ours that earlier scenarios and recordings start as programs: today's classes."""

from collections.abc import Mapping
from typing import Any

_CLASSES: Mapping[str, str] = {
    "stepbus_controller": "stepbus_controller:Controller",
    "stepbus_controller.position": "stepbus_controller.position:PositionController",
    "stepbus_gym.policy": "stepbus_gym.policy:LoadedPolicy",
    "stepbus_mission": "stepbus_mission:Mission",
    "stepbus_mission.goals": "stepbus_mission.goals:GoalSequence",
    "stepbus_mission.round_trip": "stepbus_mission.round_trip:RoundTrip",
    "stepbus_mission.store": "stepbus_store.mission:StoreMission",
    "stepbus_motion.arm": "stepbus_store.motion.arm:ArmController",
    "stepbus_motion.mobile": "stepbus_store.motion.mobile:MobileController",
    "stepbus_perception": "stepbus_store.perception:Perception",
    "stepbus_planner": "stepbus_store.planner:Planner",
    "stepbus_plant": "stepbus_plant:Plant",
    "stepbus_selftest": "stepbus_tools.selftest.tester:Tester",
    "stepbus_store.mission": "stepbus_store.mission:StoreMission",
    "stepbus_store.motion.arm": "stepbus_store.motion.arm:ArmController",
    "stepbus_store.motion.mobile": "stepbus_store.motion.mobile:MobileController",
    "stepbus_store.perception": "stepbus_store.perception:Perception",
    "stepbus_store.planner": "stepbus_store.planner:Planner",
    "stepbus_store.world_model": "stepbus_store.world_model:WorldModel",
    "stepbus_world_model": "stepbus_store.world_model:WorldModel",
}
"""Module that `exec: [python, -m, MODULE]` started → the class that `participant` names since."""


def upgraded(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scenario's plain data with the names of today."""
    rows = data.get("participants")
    if not isinstance(rows, dict):
        return dict(data)
    return {**data, "participants": {name: _row(row) for name, row in rows.items()}}


def _row(row: Any) -> Any:
    words = row.get("exec") if isinstance(row, dict) and not row.get("bridge") else None
    is_module = isinstance(words, list) and len(words) == 3 and words[:2] == ["python", "-m"]
    name = _CLASSES.get(str(words[2])) if is_module and words else None
    if name is None or row.get("participant"):
        return row
    return {"participant": name, **{key: value for key, value in row.items() if key != "exec"}}
