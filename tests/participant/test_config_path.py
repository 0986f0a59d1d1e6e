"""`config.path` takes the value of a parameter."""

import pytest

from stepbus.testing import make_config
from stepbus_schemas import WiringError


def test_a_file_is_found_by_the_value_of_a_parameter(tmp_path):
    (tmp_path / "arm.urdf").write_text("<robot/>")
    config = make_config(params={"model": "arm.urdf"}, folder=tmp_path)
    assert config.path(config.params["model"]) == tmp_path / "arm.urdf"


def test_the_name_of_a_parameter_is_no_file_and_the_error_says_what_to_write(tmp_path):
    config = make_config(params={"model": "arm.urdf"}, folder=tmp_path)
    with pytest.raises(WiringError, match=r"write config\.params\['model'\]$"):
        config.path("model")
