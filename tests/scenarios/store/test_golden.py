"""The participants of `store` against the golden log of a sale; docs/guide/testing/replay.md says how it is made.

Not the plant: its contacts, computed with other last bits on another processor, go another way.
`test_sale.py` replays that as well, on the processor that recorded it.
"""

import pytest
from support.runs.store import slow_with_robots

GOLDEN, TOLERANCE = "../golden/store.mcap", "../golden/store_tolerance.yaml"

pytestmark = [
    *slow_with_robots,
    pytest.mark.timeout(300),
    pytest.mark.filterwarnings("ignore:store.mcap. mission ended the run"),
]


@pytest.mark.stepbus_logs(GOLDEN, participant="perception")
def test_perception_does_what_it_did(stepbus_replay):
    stepbus_replay(tolerance=TOLERANCE, recorded=True)


@pytest.mark.stepbus_logs(GOLDEN, participant="mission")
def test_the_mission_does_what_it_did(stepbus_replay):
    stepbus_replay(tolerance=TOLERANCE, recorded=True)


@pytest.mark.stepbus_logs(GOLDEN, participant="controller")
def test_the_controller_does_what_it_did(stepbus_replay):
    stepbus_replay(tolerance=TOLERANCE, recorded=True)


@pytest.mark.stepbus_logs(GOLDEN, participant="planner")
def test_the_planner_does_what_it_did(stepbus_replay):
    stepbus_replay(tolerance=TOLERANCE, recorded=True)
