"""What the tests of pages share."""

import pytest
from support.pages import write_recording


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A recording of all that a page shows."""
    return write_recording(tmp_path_factory.mktemp("page") / "run.mcap")
