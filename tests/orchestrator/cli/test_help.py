"""`stepbus help`, the overview, and text that fits the terminal."""

import re
import shlex
import subprocess
import sys

import pytest
from support.runs.terminal import at_terminal

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.cli.commands import make_parser
from stepbus_orchestrator.cli.overview import GROUPS, command_names, load_commands, outlines
from stepbus_orchestrator.cli.terminal.output import fold

ALL = command_names()


def said(words, capsys, monkeypatch, columns=80):
    monkeypatch.setenv("COLUMNS", str(columns))
    # Help ends the program, where it comes from argparse.
    with pytest.raises(SystemExit, match="0"):
        raise SystemExit(main(words))
    return capsys.readouterr().out


def test_the_overview_has_every_command_in_its_group(capsys, monkeypatch):
    shown = said(["--help"], capsys, monkeypatch)
    headings = [line for line in shown.splitlines() if line in GROUPS]
    assert headings == list(GROUPS)
    texts = re.split(rf"\n(?:{'|'.join(GROUPS)})\n", shown)[1:]
    parts = dict(zip(headings, texts, strict=True))
    for command in load_commands():
        assert re.search(
            rf"^  {command.name} +{command.summary[:20]}", parts[command.group], re.MULTILINE
        )


def test_what_the_overview_reads_is_what_the_loaded_commands_say():
    loaded = {command.name: (command.summary, command.group) for command in load_commands()}
    assert {name: tuple(row) for name, row in outlines().items()} == loaded


def test_the_overview_loads_no_command():
    program = "import sys; from stepbus_orchestrator.cli.overview import overview; overview(); "
    program += "print([name for name in ('numpy', 'rich', 'matplotlib') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    assert done.stdout == b"[]\n"


def test_without_a_command_the_overview_is_an_error(capsys):
    with pytest.raises(SystemExit, match="2"):
        main([])
    assert "usage: stepbus COMMAND" in capsys.readouterr().err


def test_help_which_has_the_five_with_an_example_that_works(capsys, monkeypatch):
    shown = said(["help", "which"], capsys, monkeypatch)
    examples = [shlex.split(line)[2:] for line in shown.splitlines() if "$ stepbus" in line]
    assert [words[0] for words in examples] == ["replay", "rerun", "verify", "diff", "branch"]
    for words in examples:
        make_parser([words[0]]).parse_args(words)
    assert len(shown.splitlines()) <= 24


@pytest.mark.parametrize("name", ["run", "sweep", "help"])
def test_help_of_a_command_is_its_help(capsys, monkeypatch, name):
    by_option = said([name, "--help"], capsys, monkeypatch)
    assert said(["help", name], capsys, monkeypatch) == by_option


def test_help_of_what_is_no_command_names_the_nearest(capsys):
    assert main(["help", "brnch"]) == 2
    assert "no command 'brnch'; did you mean 'branch'?" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--help"], *([name, "--help"] for name in ALL)], ids=str)
def test_80_columns_are_enough_for_every_help_and_no_word_is_cut(capsys, monkeypatch, words):
    narrow = said(words, capsys, monkeypatch)
    assert [line for line in narrow.splitlines() if len(line) > 80] == []
    assert narrow.split() == said(words, capsys, monkeypatch, columns=79).split()
    wide = said(words, capsys, monkeypatch, columns=300)
    assert sorted(narrow.split()) == sorted(wide.split())


@pytest.mark.parametrize(
    "words",
    [
        ["run", "two_lonk"],
        ["help", "nothing-like-it"],
        ["run", "two_link", "--transport", "carrier-pigeon"],
        ["validate", "two_link", "--set", "controller.params.gain=3"],
        ["validate", "two_link", "--steps", "20"],
    ],
    ids=str,
)
def test_a_terminal_of_80_columns_gets_whole_words(words, tmp_path):
    _, shown = at_terminal(words, cwd=tmp_path, NO_COLOR="1")
    assert "\x1b[" not in shown
    long = [line for line in shown.splitlines() if len(line) > 80]
    assert [line for line in long if " " in line.strip()] == []
    assert len(shown.splitlines()) > 1
    _, coloured = at_terminal(words, cwd=tmp_path)
    assert coloured == shown.replace("stepbus:", "\x1b[1;31mstepbus:\x1b[0m", 1)


def test_a_line_with_columns_goes_on_below_the_last_one():
    text = "ok    extra sim   what the plant needs"
    assert fold(text, 30) == "ok    extra sim   what the\n" + " " * 18 + "plant needs"
    assert (
        fold("  a plain line of some words", 16, "  ") == "  a plain line\n    of some\n    words"
    )
    assert fold("a /very/long/path/that/is/whole", 12) == "a\n/very/long/path/that/is/whole"
