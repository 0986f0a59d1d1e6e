"""Our own programs against golden logs; docs/guide/testing/replay.md says how these are made."""

from support.runs.golden import golden

LOGS = "two_link*.mcap"

test_the_controller_does_what_it_did = golden(LOGS, "controller")
test_the_plant_does_what_it_did = golden(LOGS, "plant")
test_the_mission_does_what_it_did = golden(LOGS, "mission")
