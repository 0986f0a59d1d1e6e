"""The participants of `baxter` against a golden log; docs/guide/testing/replay.md says how it is made."""

from support.runs.golden import golden
from support.tools import needs_pybullet

LOG = {"folder": "../../golden", "log": "baxter.mcap", "tolerance": "baxter_tolerance.yaml"}

test_the_controller_does_what_it_did = golden(participant="controller", **LOG)
test_the_plant_does_what_it_did = needs_pybullet(golden(participant="plant", **LOG))
test_the_mission_does_what_it_did = golden(participant="mission", **LOG)
