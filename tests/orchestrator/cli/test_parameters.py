"""A command is a function: its options come from the signature, their help from the docstring."""

import inspect
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import pytest
from cyclopts import Parameter

import stepbus
from stepbus_orchestrator.cli.overview import load_command, load_commands
from stepbus_orchestrator.cli.parameters import (
    GROUP,
    Set,
    Texts,
    command,
    number,
    read_by,
    seconds,
    step_or_time,
)
from stepbus_orchestrator.cli.words import help_page, read_words


@dataclass(frozen=True, kw_only=True)
class Frame:
    """What is around it.

    Attributes
    ----------
    wood
        which
    nails
        of which length [mm]; may be repeated
    """

    wood: str = "oak"
    nails: Annotated[Texts, Parameter(name="--nail")] = ()


@command(bare={"--varnish": "1"}, rest="--with", group="look", is_run=True)
def paint_command(
    picture: Path,
    signature: str = "",
    /,
    *,
    frame: Annotated[Frame, GROUP] = Frame(),
    set: Set = (),  # noqa: A002
    colour: Annotated[Literal["red", "blue"] | None, Parameter(name="--color")] = None,
    coats: Annotated[int, read_by(number("not a number of coats", 1))] = 1,
    varnish: Annotated[int | None, Parameter(metavar="[COATS]")] = None,
    dry_first: bool = False,
    tools: Annotated[Texts, Parameter(name="--with")] = (),
) -> None:
    """Paint a picture in oil.

    Paints it. Takes
    days.

    Parameters
    ----------
    picture
        file or folder
    signature
        of the painter
    set
        override a value, e.g. a.b=1
    coats
        how many; each takes
        a day

    Examples
    --------
    $ stepbus paint a.png
    $ stepbus paint a.png me --coats 3
    """


def test_the_docstring_is_the_help_of_the_command():
    assert (paint_command.name, paint_command.summary) == ("paint", "paint a picture in oil")
    page = help_page(paint_command)
    assert page.startswith(
        "usage: stepbus paint [OPTIONS] PICTURE [SIGNATURE]\n\nPaints it. Takes days.\n\n"
    )
    assert page.endswith("examples:\n  stepbus paint a.png\n  stepbus paint a.png me --coats 3\n")
    text = " ".join(page.split())
    assert "a.b=1 --color {red,blue}" in text
    assert "each takes a day (default: 1) --varnish [COATS] --dry-first" in text
    assert "--wood WOOD which (default: oak) --nail NAIL of which length [mm]" in text
    assert "PICTURE file or folder SIGNATURE of the painter" in text
    assert "--no-" not in text


def read(*words):
    return read_words(paint_command, words).arguments


def test_what_is_given_is_what_the_function_takes():
    given = read(
        "a.png", "--set", "a=1", "--set=b=2", "--color", "red", "--nail", "3", "--dry-first"
    )
    assert (given["picture"], given["signature"]) == (Path("a.png"), "")
    assert given["set"] == ("a=1", "b=2")
    assert (given["colour"], given["coats"], given["dry_first"]) == ("red", 1, True)
    assert given["frame"] == Frame(nails=("3",))


@pytest.mark.parametrize(
    ("words", "coats"),
    [
        (["a.png"], None),
        (["a.png", "--varnish"], 1),
        (["--varnish", "3", "a.png"], 3),
        (["--varnish", "--coats", "2", "a.png"], 1),
        (["a.png", "--varnish=4"], 4),
    ],
)
def test_an_option_may_stand_without_a_value(words, coats):
    assert read(*words)["varnish"] == coats


def test_all_words_of_a_program_are_its_own():
    program = ("knife", "--coats", "x", "--", "--help", "-1")
    given = read("a.png", "--coats", "2", "--with", *program)
    assert (given["tools"], given["coats"]) == (program, 2)


def test_the_last_of_several_values_counts():
    assert read("a.png", "--coats", "2", "--coats", "3", "--dry-first", "--dry-first")["coats"] == 3


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--coats", "many"], "'many' is not a number of coats"),
        (["--coats", "0"], "'0' is not a number of coats"),
        (["--coats"], "--coats needs a value"),
        (["--color", "green"], 'invalid value "green" for --color. Choose from: "red", "blue"'),
        (["me", "you"], "unexpected argument 'you'"),
        (["--no-dry-first"], "unknown option --no-dry-first; did you mean --dry-first?"),
        (["--signature", "me"], "unknown option --signature"),
        (["--with"], "--with needs a value"),
    ],
)
def test_a_value_that_does_not_fit_is_refused(words, sentence):
    with pytest.raises(ValueError, match=re.escape(sentence)):
        read("a.png", *words)


@pytest.mark.parametrize("shipped", list(load_commands()), ids=lambda command: command.name)
def test_every_command_has_a_docstring_and_a_text_for_each_option(shipped):
    page = help_page(shipped)
    assert shipped.summary
    for label in re.findall(r"^  (\S.*)\n(?!    )", page.partition("examples:")[0], re.MULTILINE):
        assert "  " in label


@pytest.mark.parametrize(
    "function", [stepbus.replay, stepbus.rerun, stepbus.diff, stepbus.branch, stepbus.sweep]
)
def test_the_docstring_explains_every_parameter(function):
    text = " ".join(inspect.getdoc(function).split())
    explained = {
        name for names in re.findall(r"((?:\w+, )*\w+): ", text) for name in names.split(", ")
    }
    assert explained >= set(inspect.signature(function).parameters)


@pytest.mark.parametrize(
    ("text", "value"), [("10s", 10.0), ("5min", 300.0), ("200ms", 0.2), ("1/4s", 0.25)]
)
def test_a_duration_is_a_number_with_a_unit(text, value):
    assert seconds(text) == pytest.approx(value)
    given = read_words(load_command("join"), ["t", "--wait", text]).arguments
    assert given["wait"] == seconds(text)
    words = ["two_link", "--join-timeout", text, "--pause-at", text]
    given = read_words(load_command("run"), words).arguments
    assert (given["changes"].join_timeout, given["pause_at"]) == (seconds(text), text)
    given = read_words(load_command("sweep"), ["s", "--timeout", text]).arguments
    assert given["timeout_s"] == seconds(text)


def test_a_step_may_be_a_number_or_a_time():
    assert (step_or_time("12"), step_or_time("6s")) == (12, "6s")
