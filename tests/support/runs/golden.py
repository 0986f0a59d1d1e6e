"""Makes the tests of participants against golden logs."""

import pytest


def golden(
    log, participant, tolerance="tolerance.yaml", folder="../../scenarios/golden", **options
):
    """Return a test: a participant does what it did when a golden log was made.

    log: its name, or a pattern. tolerance: file beside it. folder: of both, from that of the test.
    options: of `stepbus_replay`.
    """

    @pytest.mark.stepbus_logs(f"{folder}/{log}", participant=participant)
    def test(stepbus_replay):
        stepbus_replay(tolerance=f"{folder}/{tolerance}", **options)

    return test
