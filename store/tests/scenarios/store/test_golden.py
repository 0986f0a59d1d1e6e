"""The participants of `store` against the golden log of a sale; docs/guide/testing/replay.md says how it is made.

Not the plant: its contacts, computed with other last bits on another processor, go another way.
`test_sale.py` replays that as well, on the processor that recorded it.
"""

import pytest
from support.runs.golden import golden

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(300),
]

LOG = {
    "folder": "../../golden",
    "log": "store.mcap",
    "tolerance": "store_tolerance.yaml",
    "recorded": True,
}

test_perception_does_what_it_did = golden(participant="perception", **LOG)
test_the_mission_does_what_it_did = golden(participant="mission", **LOG)
test_the_controller_does_what_it_did = golden(participant="controller", **LOG)
test_the_planner_does_what_it_did = golden(participant="planner", **LOG)
