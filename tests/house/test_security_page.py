"""docs/security.md: every test that it names exists, and so does what it promises by itself."""

import ast
import re
import tomllib

import pytest
from support.paths import CHECKOUT
from support.runs.scenario import problems_of

from stepbus_participant import is_installed

PAGE = (CHECKOUT / "docs/security.md").read_text(encoding="utf-8")
NAMED = re.findall(r"`((?:store/)?tests/[\w/]+\.py)(?:::(\w+))?`", PAGE)


@pytest.mark.parametrize(("file", "test"), NAMED)
def test_every_test_that_the_page_names_exists(file, test):
    tree = ast.parse((CHECKOUT / file).read_text(encoding="utf-8"))
    functions = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
    assert test in functions if test else functions


def test_every_attempt_names_its_test():
    table = PAGE[PAGE.index("## What was tried") :].split("\n|---|---|---|\n")[1]
    rows = table.split("\n\n")[0].splitlines()
    assert len(rows) > 20
    assert all(re.search(r"\| `((?:store/)?tests/.*|make campaign)` \|$", row) for row in rows)


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
    assert any("is not a valid name" in problem for problem in problems_of(tmp_path, text))
