"""Files by the names that a scenario gives them."""

import importlib.util

import pytest

from stepbus.testing import make_config
from stepbus_participant import find_file, package_path
from stepbus_schemas import WiringError


@pytest.mark.parametrize(
    "path", ["../stepbus_plant/__init__.py", "two_link/../../x", "/etc/passwd"]
)
def test_a_package_url_does_not_lead_out_of_its_package(tmp_path, path):
    with pytest.raises(WiringError, match="points outside its package"):
        find_file(f"package://stepbus_scenarios/{path}", tmp_path)


@pytest.mark.parametrize("scheme", ["package://", "package:///"])
def test_a_package_url_finds_a_file_of_the_package(tmp_path, scheme):
    assert find_file(f"{scheme}stepbus_scenarios/two_link/world.yaml", tmp_path).is_file()


@pytest.mark.parametrize("folder", ["scenarios", "my_robot/launch"])
def test_a_package_that_is_not_installed_may_be_a_folder_above(tmp_path, folder):
    arm = tmp_path / "my_robot" / "urdf" / "arm.urdf"
    arm.parent.mkdir(parents=True)
    arm.write_text("")
    (tmp_path / folder).mkdir()
    assert find_file("package://my_robot/urdf/arm.urdf", tmp_path / folder) == arm


def test_a_package_that_is_nowhere_is_named_with_where_it_was_looked_for(tmp_path):
    with pytest.raises(WiringError, match=f"'my_robot' is not installed.* in or above {tmp_path} "):
        find_file("package://my_robot/arm.urdf", tmp_path)
    with pytest.raises(WiringError, match=r"package 'my_robot' is not installed$"):
        package_path("package://my_robot/arm.urdf")


def test_the_command_that_installs_the_model_is_named(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(WiringError, match=r"run `make robots`$"):
        package_path("package://example-robot-data/robots/baxter.urdf")


def test_config_path_takes_the_value_of_a_parameter(tmp_path):
    (tmp_path / "arm.urdf").write_text("<robot/>")
    config = make_config(params={"model": "arm.urdf"}, folder=tmp_path)
    assert config.path(config.params["model"]) == tmp_path / "arm.urdf"
    with pytest.raises(WiringError, match=r"write config\.params\['model'\]$"):
        config.path("model")
