"""Robots of other packages give the numbers of Pinocchio and MuJoCo, or are refused with a reason."""

import re

import pytest
from support.tools import needs_pybullet, needs_store

from stepbus_participant import package_path
from stepbus_schemas import WiringError

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900), needs_pybullet, needs_store]
pytest.importorskip("lxml")
robots = pytest.importorskip("scripts.robots.__main__")


@pytest.mark.parametrize(
    "robot", robots.robots(), ids=lambda robot: f"{robot.name}-{robot.package}"
)
def test_a_robot_of_another_package_has_the_numbers_of_the_libraries(robot):
    try:
        package_path(robot.url)
    except WiringError:
        pytest.skip(f"{robot.package} is not installed: make robots-page")
    measured = robots.measure(robot)
    assert robot.note or not measured.excesses()
    assert not re.search(r"Traceback|Error\b", "\n".join(measured.refused.values()))
    for run in measured.runs.values():
        assert run.get("weight", 1.0) == pytest.approx(1.0, abs=0.01)
