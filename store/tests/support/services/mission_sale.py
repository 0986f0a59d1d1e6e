"""A sale of the mission in a fake store: run to its end, with what it sent and reported."""

from __future__ import annotations

from dataclasses import dataclass

from support.services.control import Stand
from support.services.mission_store import STEP_NS, FakeStore, config

from stepbus_schemas import RunError
from stepbus_store.mission.state_goals import GOALS
from stepbus_store.mission.store_mission import StoreMission


@dataclass
class Result:
    """How a run went."""

    goals: list
    events: list
    requests: list
    summary: str
    end: str
    error: str
    walked: list

    @property
    def goal_states(self) -> list[str]:
        """Return the state that each goal was sent from."""
        return [to for _, _, to in self.walked if to in GOALS]

    @property
    def text(self) -> str:
        return "\n".join(event.text for event in self.events)

    @property
    def errors(self) -> list[str]:
        return [event.text for event in self.events if event.level == "error"]


def sell(store: FakeStore, steps: int = 20_000, ask=None, **params) -> Result:
    """Run a mission against a store until it ends; raises AssertionError where it does not.

    ask: gets the mission before its step 50, to call it.
    """
    localized = store.drift is not None
    given = {"localized": localized, "requests": store.requested, "feels": store.feels}
    mission = StoreMission(config(**given, **params))
    mission.start({port: store.description() for port in ("poses", "planogram", "contacts")})
    walked = _watch(mission)
    stand = Stand(mission)
    result = Result([], [], [], "", "", "", walked)
    for index in range(steps):
        if index == 50 and ask is not None:
            ask(mission.calls())
        messages = {
            "poses": store.poses(),
            "odometry": store.odometry(),
            "gripper": store.gripper(),
            "imu": store.imu(),
            "stop": store.switch(index * STEP_NS * 1e-9),
        }
        if store.feels:
            messages["contacts"] = store.contacts()
        if localized:
            messages |= {"poses": store.planogram, "pose": store.pose()}
        if store.news and (status := store.news.pop(0)) is not None:
            messages["goal_status"] = status
        if store.is_due(index) and (found := store.detections()) is not None:
            messages["detections"] = found
        try:
            published = stand.update(index, **messages)
        except RunError as exc:
            result.error = str(exc)
            break
        _take(result, published)
        store.asked = published.get("camera")
        if "goal" in published:
            store.carry_out(published["goal"], walked[-1][2])
        if stand.end_reason:
            result.end = stand.end_reason
            break
    assert result.end or result.error, f"still at it after {steps} steps:\n{result.text}"
    return result


def _take(result: Result, published) -> None:
    if "goal" in published:
        result.goals.append(published["goal"])
    if "camera" in published:
        result.requests.append((result.walked[-1][2], published["camera"]))
    if "events" in published:
        result.events.append(published["events"])
    if "summary" in published:
        result.summary = published["summary"].text


def _watch(mission: StoreMission) -> list:
    """Return a list that grows by every passage: from, outcome, to."""
    walked = []
    enter = mission.enter

    def watched(store, outcome):
        before = store.visit.state
        goal = enter(store, outcome)
        walked.append((before, outcome.name, store.visit.state))
        return goal

    mission.enter = watched
    return walked
