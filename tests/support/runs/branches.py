"""Branches of a recording at random steps."""

import random

from stepbus_orchestrator.recording.reader import Recording
from stepbus_orchestrator.replay.branch import branch


def unequal(recording, folder, count, key, overrides=()):
    """Return the steps of some random ones at which a branch is not the recording."""
    last = Recording(recording).last_step
    steps = random.Random(f"15/{key}").sample(range(last + 1), count)
    return [
        (step, found.result.reason)
        for step in steps
        if not (
            found := branch(recording, folder / str(step), at=step, set=overrides, in_process=True)
        ).equal
    ]
