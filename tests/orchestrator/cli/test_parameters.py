"""A command is a function: its options come from the signature, their help from the docstring."""

import argparse
import inspect
import re
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any, Literal

import pytest

import stepbus
from stepbus_orchestrator.cli.commands import make_parser
from stepbus_orchestrator.cli.overview import load_commands
from stepbus_orchestrator.cli.parameters import (
    command,
    number,
    parameter_texts,
    seconds,
    step_or_time,
)
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.scenario.override import Overrides


def paint(
    picture: str | PathLike[str],
    *,
    set: Overrides = (),  # noqa: A002
    colour: Literal["red", "blue"] | None = None,
    coats: int = 2,
    at: int | str = 0,
    dry_first: bool = False,
    secret: str = "",
    interrupt: threading.Event | None = None,
) -> None:
    """Paint a picture.

    picture: file or folder. set: override a value, e.g. a.b=1. In Python, a map too. colour: of
    all. coats: how many; each takes a day. at: a day, or its name. dry_first: wait before. secret: not for all. interrupt:
    ends it.
    """


@dataclass(frozen=True, kw_only=True)
class Frame:
    """What is around it. wood: which. nails: of which length [mm]; may be repeated."""

    wood: str = "oak"
    nails: Annotated[Sequence[str], {"flag": "--nail"}] = ()


@command(of=paint, hidden=["secret"], exclusive=["at", "dry_first"], colour={"flag": "--color"})
def paint_command(
    signature: str = "",
    *,
    frame: Frame,
    coats: Annotated[int, {"type": number("not a number of coats", 1)}] = 1,
    **given: Any,
) -> Answer:
    """Paint a picture in oil.

    Paints it. Takes days.

    signature: of the painter.

    $ stepbus paint a.png
    $ stepbus paint a.png me --coats 3
    """
    paint(**given, coats=coats)
    return Answer(value={**given, "coats": coats, "frame": vars(frame)}, lines=[signature], code=3)


@pytest.fixture
def parser():
    parser = argparse.ArgumentParser("paint")
    paint_command.add_arguments(parser)
    return parser


def test_the_docstring_is_the_help_of_the_command():
    assert (paint_command.name, paint_command.summary) == ("paint", "paint a picture in oil")
    assert paint_command.description == "Paints it. Takes days."
    assert paint_command.examples == ["stepbus paint a.png", "stepbus paint a.png me --coats 3"]


def test_the_help_of_an_option_is_the_first_sentence_of_the_docstring(parser):
    assert parameter_texts(paint)["set"] == "override a value, e.g. a.b=1"
    text = " ".join(parser.format_help().split())
    assert "--set PATH=VALUE override a value, e.g. a.b=1 --color {red,blue} of all" in text
    assert "--coats COATS how many; each takes a day (default: 1)" in text
    assert "--wood WOOD which (default: oak) --nail NAILS of which length [mm]" in text
    assert "picture file or folder signature of the painter" in text
    assert "--dry-first wait before" in text
    assert "secret" not in text
    assert "interrupt" not in text


def test_what_is_given_is_what_the_function_takes(parser, capsys):
    args = parser.parse_args(
        ["a.png", "--set", "a=1", "--set", "b=2", "--color", "red", "--at", "6s", "--nail", "3",
         "--json"]
    )  # fmt: skip
    assert paint_command.execute(args) == 3
    assert args.picture == Path("a.png")
    assert args.set == ["a=1", "b=2"]
    assert (args.colour, args.at, args.dry_first) == ("red", "6s", False)
    assert '"wood": "oak",\n    "nails": [\n      "3"' in capsys.readouterr().out


def test_without_json_the_answer_is_its_lines(parser, capsys):
    assert paint_command.execute(parser.parse_args(["a.png", "me"])) == 3
    assert capsys.readouterr().out == "me\n"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--coats", "many"], "argument --coats: 'many' is not a number of coats"),
        (["--coats", "0"], "argument --coats: '0' is not a number of coats"),
        (["--color", "green"], "argument --color: invalid choice: 'green'"),
        (["--at", "3", "--dry-first"], "--dry-first: not allowed with argument --at"),
    ],
)
def test_a_value_that_does_not_fit_is_refused(parser, capsys, words, sentence):
    with pytest.raises(SystemExit):
        parser.parse_args(["a.png", *words])
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(
    "function", [stepbus.replay, stepbus.rerun, stepbus.diff, stepbus.branch, stepbus.sweep]
)
def test_the_docstring_explains_every_parameter(function):
    assert set(parameter_texts(function)) >= set(inspect.signature(function).parameters)


class Listing:
    """Lists the options that have no help."""

    def __init__(self):
        self.unexplained = []

    def add_mutually_exclusive_group(self):
        return self

    def add_argument(self, name, help="", **_):  # noqa: A002
        self.unexplained += [] if help else [name]
        return SimpleNamespace()


@pytest.mark.parametrize("each", load_commands(), ids=lambda each: each.name)
def test_every_option_of_every_command_is_explained(each):
    listing = Listing()
    each.add_arguments(listing)
    assert listing.unexplained == []


def options_of(each):
    parser = argparse.ArgumentParser(each.name)
    each.add_arguments(parser)
    return re.sub(r"\s+", " ", parser.format_usage())


def test_every_command_calls_the_place_it_writes_to_the_same():
    found = [re.findall(r"--out (\w+)", options_of(each)) for each in load_commands()]
    assert {name for names in found for name in names} == {"FOLDER", "FILE"}
    assert not [each.name for each in load_commands() if "--keep FOLDER" in options_of(each)]


@pytest.mark.parametrize(
    ("text", "value"), [("10s", 10.0), ("5min", 300.0), ("200ms", 0.2), ("1/4s", 0.25)]
)
def test_a_duration_is_a_number_with_a_unit(text, value):
    assert seconds(text) == pytest.approx(value)
    assert make_parser(["join"]).parse_args(["join", "t", "--wait", text]).wait == seconds(text)
    words = ["run", "two_link", "--join-timeout", text, "--pause-at", text]
    run = make_parser(["run"]).parse_args(words)
    assert (run.join_timeout, run.pause_at) == (seconds(text), text)
    assert make_parser(["sweep"]).parse_args(
        ["sweep", "s", "--timeout", text]
    ).timeout_s == seconds(text)


def test_a_step_may_be_a_number_or_a_time():
    assert (step_or_time("12"), step_or_time("6s")) == (12, "6s")
