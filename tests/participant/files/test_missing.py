"""Without the model of a robot, one sentence says what to install."""

import importlib.util

import pytest

from stepbus_participant import package_path
from stepbus_schemas import WiringError


def test_the_command_that_installs_the_model_is_named(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(WiringError, match=r"run `make robots`$"):
        package_path("package://example-robot-data/robots/baxter.urdf")


def test_other_packages_are_not_ours_to_install():
    with pytest.raises(WiringError, match=r"package 'my_robot' is not installed$"):
        package_path("package://my_robot/arm.urdf")
