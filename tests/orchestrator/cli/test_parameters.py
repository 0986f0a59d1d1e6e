"""Options of a command come from the signature and the docstring of its function."""

import argparse
import inspect
import threading
from os import PathLike
from pathlib import Path
from typing import Literal

import pytest

import stepbus
from stepbus_orchestrator.cli.parameters import add_parameters, parameter_texts, parameters_of
from stepbus_orchestrator.scenario import Overrides


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


@pytest.fixture
def parser():
    parser = argparse.ArgumentParser("paint")
    add_parameters(parser, paint, secret=None, colour={"flag": "--color"})
    return parser


def test_the_help_is_the_first_sentence_of_the_docstring(parser):
    assert parameter_texts(paint)["set"] == "override a value, e.g. a.b=1"
    text = " ".join(parser.format_help().split())
    assert "--set PATH=VALUE override a value, e.g. a.b=1 --color {red,blue} of all" in text
    assert "--coats COATS how many; each takes a day (default: 2)" in text
    assert "--dry-first wait before" in text
    assert "secret" not in text
    assert "interrupt" not in text


def test_what_is_given_is_what_the_function_takes(parser):
    args = parser.parse_args(
        ["a.png", "--set", "a=1", "--set", "b=2", "--color", "red", "--at", "6s", "--dry-first"]
    )
    assert parameters_of(args, paint) == {
        "picture": Path("a.png"), "set": ["a=1", "b=2"], "colour": "red", "coats": 2, "at": "6s", "dry_first": True,
    }  # fmt: skip
    paint(**parameters_of(args, paint))


def test_a_value_of_another_type_is_refused(parser, capsys):
    with pytest.raises(SystemExit):
        parser.parse_args(["a.png", "--coats", "many"])
    assert "argument --coats: invalid int value: 'many'" in capsys.readouterr().err


@pytest.mark.parametrize("function", [stepbus.replay, stepbus.rerun, stepbus.diff, stepbus.branch])
def test_the_docstring_explains_every_parameter(function):
    assert set(parameter_texts(function)) >= set(inspect.signature(function).parameters)
