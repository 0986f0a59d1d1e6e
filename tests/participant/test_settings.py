"""Parameters of a participant, read with checks."""

import math
from pathlib import Path

import pytest

from stepbus_participant import Config
from stepbus_participant.settings import Settings, nearest
from stepbus_schemas import WiringError


def settings(**params) -> Settings:
    given = Config(
        name="x", step_ns=1, every=1, seed=0, folder=Path(), inputs={}, outputs={}, params=params
    )
    return Settings(given)


@pytest.mark.parametrize("value", [True, "1", math.nan, math.inf, 10**400, [1], {}])
def test_what_is_no_finite_number_is_refused_in_one_sentence(value):
    given = settings(gain=value)
    given.number("gain")
    with pytest.raises(
        WiringError, match=r"^participants\.x\.params\.gain: is .*, not a finite number$"
    ):
        given.check()


def test_a_key_that_is_a_number_is_unknown_like_any_other():
    assert nearest(3, ["elbow", "wrist_3"]) == "there is elbow, wrist_3"
    given = settings(gain={3: 1.0, "elbow": 2.0})
    assert given.per_name("gain", ["elbow"]) == [2.0]
    with pytest.raises(WiringError, match="gain: 3 is unknown; there is elbow"):
        given.check()
