"""docs/reference/cli.md and docs/exit-codes.md say what the command line does."""

import re

import pytest
from support.paths import DOCS

from stepbus_orchestrator.cli.app import command_names, help_page, load_command
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.scenario.locate import builtin_names

PAGE = (DOCS / "reference/cli.md").read_text(encoding="utf-8")
INTRODUCTION, *PARTS = re.split(r"^## ", PAGE, flags=re.MULTILINE)
SECTIONS = {part.partition("\n")[0]: part for part in PARTS}


def options(name):
    """Return the options of a command."""
    page = help_page(load_command(name))
    return set(re.findall(r"^  (--?\w[\w-]*)", page, re.MULTILINE)) - {"-h"}


def test_every_command_has_its_section():
    assert sorted(SECTIONS) == sorted(command_names())


@pytest.mark.parametrize("name", command_names())
def test_the_table_of_a_command_has_all_of_its_options(name):
    first_cells = re.findall(r"^\| (.*?) \|", SECTIONS[name], re.MULTILINE)
    assert set(re.findall(r"`(--?\w[\w-]*)", " ".join(first_cells))) == options(name)


def test_every_built_in_scenario_is_named():
    assert set(builtin_names()) <= set(re.findall(r"`([\w/]+)`", INTRODUCTION))


def test_the_page_of_exit_codes_has_every_code():
    rows = re.findall(r"^\| (\d+) \| (\w+) \|", (DOCS / "exit-codes.md").read_text(), re.MULTILINE)
    assert [(int(code), name) for code, name in rows] == [(int(c), c.name) for c in ExitCode]
