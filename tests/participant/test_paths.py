"""Files by the names that a scenario gives them."""

import pytest

from stepbus_participant import find_file
from stepbus_schemas import WiringError


@pytest.mark.parametrize(
    "path", ["../stepbus_plant/__init__.py", "two_link/../../x", "/etc/passwd"]
)
def test_a_package_url_does_not_lead_out_of_its_package(tmp_path, path):
    with pytest.raises(WiringError, match="leads out of its package"):
        find_file(f"package://stepbus_scenarios/{path}", tmp_path)


def test_a_package_url_finds_a_file_of_the_package(tmp_path):
    assert find_file("package://stepbus_scenarios/two_link/world.yaml", tmp_path).is_file()
