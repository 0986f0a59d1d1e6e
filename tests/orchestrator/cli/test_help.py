"""`stepbus help`, the overview, and text that fits the terminal."""

import re

import pytest
from support.runs.terminal import at_terminal

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.cli.app import command_names, load_commands, summary_of
from stepbus_orchestrator.cli.options import GROUPS

ALL = command_names()


def said(words, capsys, monkeypatch, columns=80):
    monkeypatch.setenv("COLUMNS", str(columns))
    # Help ends the program, where an option asks for it.
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
            rf"^  {command.word()} +{summary_of(command)[:20]}",
            parts[command.group],
            re.MULTILINE,
        )


def test_without_a_command_the_overview_is_an_error(capsys):
    with pytest.raises(SystemExit, match="2"):
        main([])
    assert "usage: stepbus COMMAND" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["run", "sweep", "help"])
def test_help_of_a_command_is_its_help(capsys, monkeypatch, name):
    by_option = said([name, "--help"], capsys, monkeypatch)
    assert said(["help", name], capsys, monkeypatch) == by_option


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
