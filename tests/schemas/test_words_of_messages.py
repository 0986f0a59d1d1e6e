"""Messages that are made with a word that their type does not have."""

from __future__ import annotations

from typing import Annotated, Literal

import pytest

from stepbus_schemas import (
    Event,
    Goal,
    GoalStatus,
    Image,
    JointCommand,
    Message,
    MessageError,
    Types,
)


class Lamp(Message, frozen=True):
    """A class of a user's own, with its annotations as text."""

    colour: Annotated[Literal["red", "green"] | None, "anything"] = None


WRONG = [
    (JointCommand, {"mode": "tork", "values": [0.0]}, "mode", "torque"),
    (Event, {"level": "warn", "text": ""}, "level", "warning"),
    (Goal, {"id": 0, "type": "move_joint"}, "type", "move_joints"),
    (GoalStatus, {"id": 0, "state": "succeded"}, "state", "succeeded"),
    (Lamp, {"colour": "rod"}, "colour", "red"),
    (Types({"Valve/1": {"way": ["open", "shut"]}})["Valve/1"], {"way": "opn"}, "way", "open"),
]


@pytest.mark.parametrize(("cls", "fields", "name", "meant"), WRONG)
def test_a_word_that_a_message_does_not_have_is_refused_where_it_is_made(cls, fields, name, meant):
    with pytest.raises(MessageError) as caught:
        cls(**fields)
    assert str(caught.value).startswith(f"{cls.__name__}: {name} must be ")
    assert str(caught.value).endswith(f", not {fields[name]!r}; did you mean {meant!r}?")


def test_what_is_not_even_a_word_is_refused():
    with pytest.raises(MessageError, match=r"mode must be .* or brake, not 3"):
        JointCommand(mode=3, values=[])
    with pytest.raises(MessageError, match="encoding must be rgb8 or 32FC1"):
        Image(width=1, height=1, encoding="png", data=b"", focal=(1, 1), centre=(0, 0))


class Counted(Message, frozen=True):
    """Has a check of its own, and numbers as words."""

    size: Literal[1, 2, 10]
    free: float = 0.0

    def __post_init__(self):
        if self.free < 0:
            raise ValueError("free is negative")


def test_a_check_of_the_users_own_stays():
    with pytest.raises(MessageError, match="Counted: size must be 1, 2 or 10, not 3"):
        Counted(size=3)
    with pytest.raises(ValueError, match="free is negative"):
        Counted(size=1, free=-1.0)
    assert Counted(size=10).size == 10


def test_a_word_that_may_be_absent_may_be():
    assert Lamp().colour is None
