"""What the tests of runs in one process share."""

import pytest
from support.runs.joints import run_joints


@pytest.fixture(autouse=True)
def _surroundings_are_restored(left_as_found):
    return


@pytest.fixture(scope="module")
def separate(tmp_path_factory):
    """The run of the same scenario with processes."""
    result = run_joints(tmp_path_factory.mktemp("separate"))
    assert result.exit_code == 0, result.reason
    return result
