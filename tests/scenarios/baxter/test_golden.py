"""The participants of `baxter` against a golden log; docs/guide/testing/replay.md says how it is made."""

import pytest
from support.runs.golden import golden

from stepbus_participant import package_path
from stepbus_schemas import WiringError

try:
    package_path("package://example-robot-data/robots")
except WiringError as exc:
    pytest.skip(str(exc), allow_module_level=True)

LOG = {"log": "baxter.mcap", "tolerance": "baxter_tolerance.yaml"}

test_the_controller_does_what_it_did = golden(participant="controller", **LOG)
test_the_plant_does_what_it_did = golden(participant="plant", **LOG)
test_the_mission_does_what_it_did = golden(participant="mission", **LOG)
