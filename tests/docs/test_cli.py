"""docs/reference/cli.md and docs/exit-codes.md say what the command line does."""

import re

import pytest
from support.paths import DOCS

from stepbus_orchestrator.cli.overview import load_commands
from stepbus_orchestrator.cli.words import help_page
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.scenario.locate import builtin_names

PAGE = (DOCS / "reference/cli.md").read_text(encoding="utf-8")
INTRODUCTION, *PARTS = re.split(r"^## ", PAGE, flags=re.MULTILINE)
SECTIONS = {part.partition("\n")[0]: part for part in PARTS}


def options(command):
    """Return the options of a command."""
    return set(re.findall(r"^  (--?\w[\w-]*)", help_page(command), re.MULTILINE)) - {"-h"}


def test_every_command_has_its_section():
    assert sorted(SECTIONS) == sorted(command.name for command in load_commands())


@pytest.mark.parametrize("command", list(load_commands()), ids=lambda command: command.name)
def test_the_table_of_a_command_has_all_of_its_options(command):
    first_cells = re.findall(r"^\| (.*?) \|", SECTIONS[command.name], re.MULTILINE)
    assert set(re.findall(r"`(--?\w[\w-]*)", " ".join(first_cells))) == options(command)


def test_every_built_in_scenario_is_named():
    assert set(builtin_names()) <= set(re.findall(r"`([\w/]+)`", INTRODUCTION))


def test_the_page_of_exit_codes_has_every_code():
    rows = re.findall(r"^\| (\d+) \| (\w+) \|", (DOCS / "exit-codes.md").read_text(), re.MULTILINE)
    assert [(int(code), name) for code, name in rows] == [(int(c), c.name) for c in ExitCode]
