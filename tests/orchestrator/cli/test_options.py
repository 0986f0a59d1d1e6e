"""A command is a class: its fields are its options, its docstrings their help."""

import re
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Annotated, Literal

import pytest
from cyclopts import Parameter

from stepbus_orchestrator.cli import app
from stepbus_orchestrator.cli.dispatch import parsed
from stepbus_orchestrator.cli.options import EITHER, FLAT, Command, Count, Port, Settings


@dataclass(frozen=True, kw_only=True)
class Frame:
    """What is around it."""

    wood: str = "oak"
    """which wood"""
    nails: Annotated[tuple[str, ...], Parameter(name="--nail")] = ()
    """length of a nail [mm]; may be repeated"""


class Paint(Command, work="nowhere", group="look"):
    """Paint a picture in oil.

    Paints it. Takes days.

    $ stepbus paint a.png
    $ stepbus paint a.png me --coats 3
    """

    picture: Path
    """file or folder"""
    words: tuple[str, ...] = ()
    """words of the painter"""
    _: KW_ONLY
    frame: Annotated[Frame, FLAT] = Frame()
    set: Settings = ()
    """override a value, e.g. a.b=1"""
    colour: Annotated[Literal["red", "blue"] | None, Parameter(name="--color")] = None
    """colour of all"""
    coats: Count = 2
    """each takes a day"""
    dry: Annotated[bool, EITHER] = False
    wet: Annotated[bool, EITHER] = False
    show: Annotated[tuple[Port, ...] | None, Parameter(consume_multiple=(0, 1))] = None
    program: Annotated[
        tuple[str, ...], Parameter(name="--exec", consume_multiple=True, allow_leading_hyphen=True)
    ] = ()


@pytest.fixture(autouse=True)
def paint(monkeypatch):
    monkeypatch.setitem(app.OWN, "paint", Paint)


def test_the_docstrings_are_the_help():
    assert app.summary_of(Paint) == "paint a picture in oil"
    assert app.examples_of(Paint) == [" stepbus paint a.png", " stepbus paint a.png me --coats 3"]
    text = " ".join(app.help_page(app.load_command("paint")).split())
    assert "usage: stepbus paint [OPTIONS] PICTURE [WORDS ...] Paints it. Takes days." in text
    assert "--color {red,blue} colour of all" in text
    assert "each takes a day (default: 2)" in text
    assert "which wood (default: oak) --nail NAIL length of a nail [mm]; may be repeated" in text
    assert "arguments: PICTURE file or folder WORDS ... words of the painter" in text


@pytest.mark.parametrize(
    ("words", "field", "value"),
    [
        ("a.png", "picture", Path("a.png")),
        ("a.png me -0.5", "words", ("me", "-0.5")),
        ("a.png --coats 3 -- me --coats", "words", ("me", "--coats")),
        ("a.png --set a=1 --set b=2", "set", ("a=1", "b=2")),
        ("a.png --color red", "colour", "red"),
        ("a.png --coats 3 --coats 4", "coats", 4),
        ("a.png --nail 3 --nail 4", "frame", Frame(nails=("3", "4"))),
        ("a.png --show --wet", "show", ()),
        ("a.png --show 8765", "show", (8765,)),
        ("a.png --exec ./mine --wet 3", "program", ("./mine", "--wet", "3")),
    ],
)
def test_words_become_fields(words, field, value):
    assert getattr(parsed("paint", *words.split()), field) == value


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("a.png --coats many", 'unable to convert "many" into int'),
        ("a.png --coats 0", "Must be >= 1"),
        ("a.png --color green", 'Choose from: "red", "blue"'),
        ("a.png --dry --wet", "Mutually exclusive arguments: {--dry, --wet}"),
        ("a.png --show 70000", "Must be <= 65535"),
        ("", "PICTURE is missing"),
    ],
)
def test_words_that_do_not_fit_are_refused(words, sentence, capsys):
    with pytest.raises(SystemExit, match="2"):
        parsed("paint", *words.split())
    said = " ".join(capsys.readouterr().err.split())
    assert sentence in said
    assert said.endswith("see stepbus paint --help")


@pytest.mark.parametrize("name", app.command_names())
def test_every_option_of_every_command_has_a_help(name):
    page = app.help_page(app.load_command(name))
    rows = re.findall(r"^  (?=\S)(?!stepbus)(.*)\n?(.*)", page, re.MULTILINE)
    assert [row for row, below in rows if "  " not in row and not below.startswith("    ")] == []
