"""What the tests of unauthenticated processes share: a run without any."""

import pytest
from support.runs.joints import run_joints
from support.runs.stranger import PATIENT


@pytest.fixture(scope="session")
def reference(tmp_path_factory):
    """Return the result of the run that nobody disturbs."""
    return run_joints(tmp_path_factory.mktemp("reference"), *PATIENT, in_process=True)
