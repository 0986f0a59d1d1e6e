"""What the tests of unauthenticated processes share: a run without any, and what must be left."""

import pytest
from support.runs.joints import leftovers, run_joints
from support.runs.stranger import PATIENT


@pytest.fixture(scope="session")
def reference(tmp_path_factory):
    """Return the result of the run that nobody disturbs."""
    return run_joints(tmp_path_factory.mktemp("reference"), *PATIENT, in_process=True)


@pytest.fixture
def nothing_is_left(tmp_path, own_temp):
    """Check that a run leaves no process and no file."""
    yield
    assert leftovers(tmp_path) == []
    assert list(own_temp.iterdir()) == []
