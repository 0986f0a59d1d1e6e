"""Names that no scenario may give, and packages that none may replace."""

import tomllib

import pytest
from support.paths import CHECKOUT
from support.runs.scenario import problems_of

from stepbus_participant import is_installed


def test_no_package_of_ours_can_be_replaced():
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))
    folders = project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    names = [folder.rpartition("/")[2] for folder in folders]
    ours = [name for name in names if name.startswith("stepbus")]
    assert len(ours) > 10
    assert all(map(is_installed, ours))
    assert not is_installed("controller")


@pytest.mark.parametrize("name", ["../plant", "/plant", "a/b", ".hidden", "a\\0b", "x" * 65])
@pytest.mark.parametrize("what", ["participant", "port", "scenario"])
def test_names_of_a_scenario_are_no_paths(tmp_path, what, name):
    names = {"participant": "p", "port": "out", "scenario": "s", what: name}
    text = (
        f'name: "{names["scenario"]}"\nstep: 5ms\nduration: 50ms\nparticipants:\n'
        f'  "{names["participant"]}": {{exec: [python], outputs: '
        f'{{"{names["port"]}": JointState/1}}}}\n'
    )
    assert any("must be a name of 1 to 64" in problem for problem in problems_of(tmp_path, text))
