"""The engines that are installed, one after the other."""

import pytest

from stepbus_plant.engines import ENGINES, is_here


@pytest.fixture(params=ENGINES)
def engine(request):
    """Return the name of an engine; one that is not installed is skipped."""
    if not is_here(request.param):
        pytest.skip(f"{request.param} is not installed")
    return request.param
