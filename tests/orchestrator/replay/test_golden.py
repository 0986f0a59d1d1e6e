"""Our own programs against golden logs; docs/guide/testing/replay.md says how these are made."""

import pytest

GOLDEN, TOLERANCE = "../../scenarios/golden/two_link*.mcap", "../../scenarios/golden/tolerance.yaml"


@pytest.mark.stepbus_logs(GOLDEN, participant="controller")
def test_the_controller_does_what_it_did(stepbus_replay):
    stepbus_replay(tolerance=TOLERANCE)


@pytest.mark.stepbus_logs(GOLDEN, participant="plant")
def test_the_plant_does_what_it_did(stepbus_replay):
    stepbus_replay(tolerance=TOLERANCE)


@pytest.mark.stepbus_logs(GOLDEN, participant="mission")
def test_the_mission_does_what_it_did(stepbus_replay):
    stepbus_replay(tolerance=TOLERANCE)
