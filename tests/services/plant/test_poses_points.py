"""Points of links have poses of their own."""

import pytest

from stepbus_orchestrator.errors import ScenarioError
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load


@pytest.mark.parametrize(
    ("point", "why"),
    [
        ("{tip: {link: link3, position: [1, 0, 0]}}", "link 'link3' is unknown"),
        ("{link2: {link: link2, position: [1, 0, 0]}}", "'link2' is already the name of a link"),
    ],
)
def test_a_point_that_cannot_be_is_refused_with_its_name(tmp_path, point, why):
    scenario = load("two_link/tip", ["duration=10ms", f"plant.params.points={point}"])
    result = run(scenario, Options(out=tmp_path / "out", host=InProcess()))
    assert why in result.reason


def test_a_point_needs_a_link():
    with pytest.raises(ScenarioError, match="link"):
        load("two_link/tip", ["plant.params.points={tip: {position: [1, 0, 0]}}"])
