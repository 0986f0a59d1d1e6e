"""The arm of these tests."""

import pytest
from support.services.manipulator import make_robot


@pytest.fixture(scope="module")
def robot():
    return make_robot()
