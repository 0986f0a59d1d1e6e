"""The mobile manipulators of these tests."""

import pytest
from support.services.mobile import Robot, config


@pytest.fixture
def robot(tmp_path):
    return Robot(config(tmp_path))
