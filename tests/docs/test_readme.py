"""What the README shows is what happens."""

import re
from pathlib import Path

import pytest

from stepbus_orchestrator import Options, load
from stepbus_orchestrator.cli import COMMANDS
from stepbus_orchestrator.run.run_scenario import run

CHECKOUT = Path(__file__).parents[2]
README = (CHECKOUT / "README.md").read_text(encoding="utf-8")
PAGES = [CHECKOUT / "README.md", *sorted((CHECKOUT / "docs").glob("*.md"))]


def file_of(name: str) -> str:
    """Return a file that the README shows in full."""
    return re.search(rf"<!-- {name} -->\n```\w+\n(.*?)```", README, re.DOTALL)[1]


def test_the_controller_of_the_readme_drives_the_arm(tmp_path):
    for name in ("my_controller.py", "scenario.yaml"):
        (tmp_path / name).write_text(file_of(name))
    result = run(load(tmp_path, ["duration=500ms"]), Options(out=tmp_path / "out"))
    assert (result.exit_code, result.steps, result.drops) == (
        0, 100, {"plant": 0, "controller": 0, "mission": 0}
    )  # fmt: skip


def test_the_controller_of_the_readme_has_at_most_15_lines():
    assert len(file_of("my_controller.py").splitlines()) <= 15


def test_the_readme_names_no_command_that_does_not_exist():
    named = set(re.findall(r"(?:`|^\$ )stepbus (\w+)", README, re.MULTILINE))
    assert named <= {command.name for command in COMMANDS}
    assert "run" in named


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_to_a_file(page):
    targets = re.findall(r"\]\((?!https?://)([^)#]+)", page.read_text(encoding="utf-8"))
    assert [target for target in targets if not (page.parent / target).exists()] == []
