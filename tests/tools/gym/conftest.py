"""What the tests of environments share."""

import pytest

gymnasium = pytest.importorskip("gymnasium")


@pytest.fixture(autouse=True)
def _process_is_left_as_it_was(left_as_found):
    return
