"""Files by the names that a scenario gives them."""

import pytest

from stepbus_participant import find_file
from stepbus_schemas import WiringError


@pytest.mark.parametrize(
    "path", ["../stepbus_plant/__init__.py", "two_link/../../x", "/etc/passwd"]
)
def test_a_package_url_does_not_lead_out_of_its_package(tmp_path, path):
    with pytest.raises(WiringError, match="points outside its package"):
        find_file(f"package://stepbus_scenarios/{path}", tmp_path)


def test_a_package_url_finds_a_file_of_the_package(tmp_path):
    assert find_file("package://stepbus_scenarios/two_link/world.yaml", tmp_path).is_file()
    assert find_file("package:///stepbus_scenarios/two_link/world.yaml", tmp_path).is_file()


def test_a_package_that_is_not_installed_may_be_a_folder_above(tmp_path):
    arm = tmp_path / "my_robot" / "urdf" / "arm.urdf"
    arm.parent.mkdir(parents=True)
    arm.write_text("")
    (tmp_path / "scenarios").mkdir()
    assert find_file("package://my_robot/urdf/arm.urdf", tmp_path / "scenarios") == arm


def test_a_package_that_is_nowhere_is_named_with_where_it_was_looked_for(tmp_path):
    with pytest.raises(WiringError, match=f"'my_robot' is not installed.* in or above {tmp_path} "):
        find_file("package://my_robot/arm.urdf", tmp_path)
