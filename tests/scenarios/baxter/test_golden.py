"""The participants of `baxter` against a golden log; docs/guide/testing/replay.md says how it is made."""

import pytest

from stepbus_participant import package_path
from stepbus_schemas import WiringError

try:
    package_path("package://example-robot-data/robots")
except WiringError as exc:
    pytest.skip(str(exc), allow_module_level=True)

GOLDEN, TOLERANCE = "../golden/baxter.mcap", "../golden/baxter_tolerance.yaml"


@pytest.mark.stepbus_logs(GOLDEN, participant="controller")
def test_the_controller_does_what_it_did(stepbus_replay):
    stepbus_replay(tolerance=TOLERANCE)


@pytest.mark.stepbus_logs(GOLDEN, participant="plant")
def test_the_plant_does_what_it_did(stepbus_replay):
    stepbus_replay(tolerance=TOLERANCE)


@pytest.mark.stepbus_logs(GOLDEN, participant="mission")
def test_the_mission_does_what_it_did(stepbus_replay):
    stepbus_replay(tolerance=TOLERANCE)
