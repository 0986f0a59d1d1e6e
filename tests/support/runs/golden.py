"""Makes the tests of participants against golden logs."""

import pytest


def golden(log, participant, tolerance="tolerance.yaml", **options):
    """Return a test: a participant does what it did when a log of tests/scenarios/golden was made.

    log: its name, or a pattern. tolerance: file beside it. options: of `stepbus_replay`. The test
    stands in a folder two levels below `tests`.
    """
    folder = "../../scenarios/golden"

    @pytest.mark.stepbus_logs(f"{folder}/{log}", participant=participant)
    def test(stepbus_replay):
        stepbus_replay(tolerance=f"{folder}/{tolerance}", **options)

    return test
