"""Parameters declared once: what each type takes, and what is said about the rest."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepbus import Config, Settings
from stepbus.errors import SettingsError
from stepbus.params import (
    Count,
    Duration,
    File,
    Finite,
    Names,
    PerJoint,
    Plugin,
    Positive,
    Text,
    Vector3,
    Whole,
    each,
)
from stepbus_participant import Name, Own, Problems
from stepbus_participant.parameters import Pause, find_problems, read


class Spring(Settings):
    """A row that a text stands for, too."""

    short = "kind"

    kind: Text
    stiffness: Finite = 1.0


class Params(Settings):
    """One field of each type."""

    joints: Names
    law: Literal["pd", "pid"] | Plugin = "pd"
    kp: PerJoint = each(1.0)
    model: File | None = None
    flag: bool = False
    count: Count = 1
    whole: Whole = 0
    limit: Positive | None = None
    gravity: Vector3 = (0.0, 0.0, -9.81)
    latency_ns: Duration = 5_000_000
    at_ns: Pause = 0
    springs: tuple[Spring, ...] = ()
    named: dict[Name, Positive] = {}  # noqa: RUF012  Settings copy their defaults
    own: Own = {}  # noqa: RUF012


class PID(Params):
    """The further fields of a law."""

    ki: PerJoint
    windup: bool = True


Params.kinds = ("law", {"pd": Params, "pid": PID})


def problem(**params):
    ((keys, text),) = find_problems(Params, {"joints": ["a", "b"], **params})
    return f"{'.'.join(map(str, keys))}: {text}"


def test_what_is_right_is_read_into_types():
    params = Params.of(
        {
            "joints": ["a", "b"],
            "law": "pid",
            "kp": {"b": 2, "a": 1},
            "ki": [3, 4],
            "latency": "1/200s",
            "at": "0.00s",
            "springs": ["soft", {"kind": "hard", "stiffness": 5}],
        }
    )
    assert (params.kp.of(params.joints), params.ki.of(params.joints)) == ([1, 2], [3, 4])
    assert (params.latency_ns, params.at_ns) == (5_000_000, 0)
    assert [(row.kind, row.stiffness) for row in params.springs] == [("soft", 1.0), ("hard", 5.0)]
    assert params.gravity == (0.0, 0.0, -9.81)


MISTAKES = [
    ({"flag": 1}, "flag: must be true or false, not 1"),
    ({"count": 0}, "count: must be an integer of at least 1, not 0"),
    ({"count": 1.5}, "count: must be an integer of at least 1, not 1.5"),
    ({"count": True}, "count: must be an integer of at least 1, not true"),
    ({"whole": -1}, "whole: must be an integer of at least 0, not -1"),
    ({"limit": 0}, "limit: must be a number above 0, not 0"),
    ({"limit": math.nan}, "limit: must be a number above 0, not nan"),
    ({"limit": 10**400}, f"limit: must be a number above 0, not 1{'0' * 59}…"),
    ({"limit": '3'}, "limit: must be a number above 0, not '3'"),
    ({"limit": '1/2'}, "limit: must be a number above 0, not '1/2'"),
    ({"gravity": [1, 2]}, 'gravity: must be a list of 3 values'),
    ({"gravity": [1, 2, []]}, "gravity.2: must be a number, not a list"),
    ({"latency": 5}, 'latency: must be a duration with a'),
    ({"latency": "0s"}, "latency: '0s' must be longer than 0"),
    ({"kp": [1]}, "kp: has 1 numbers for 2 joints (a, b)"),
    ({"kp": {"a": 1, "b": 1, "c": 1}}, "kp.c: unknown joint 'c'; known: a, b"),
    ({"kp": {"a": 1}}, "kp: joint 'b' is missing"),
    ({"kp": ["x", 1]}, "kp.0: must be a number, not 'x'"),
    ({"joints": []}, "joints: must be a list of one or more names, not a list of 0"),
    ({"joints": ["a", ""]}, "joints.1: must be text that is not empty"),
    ({"joints": ["a", "a"]}, "joints: names 'a' twice"),
    ({"law": "pdd"}, "law: must be pd, pid or file.py:Class … did you mean 'pd'"),
    ({"law": 3}, 'law: must be pd, pid or file.py:Class'),
    ({"law": "pid"}, ": the key 'ki' is missing"),
    ({"ki": 3}, 'ki: applies only with law pid'),
    ({"springs": [{"kind": 3}]}, "springs.0.kind: must be text that is not empty, not 3"),
    ({"law": "pid", "ki": "x"}, "ki: must be a number, a list or a map, not 'x'"),
    ({"springs": {"a": 1}}, "springs: must be a list, not a map"),
    ({"springs": [3]}, "springs.0: must be text or a map, not 3"),
    ({"springs": [None]}, "springs.0: the key 'kind' is missing"),
    ({"springs": [{"knd": 1, "kind": "a"}]}, "springs.0.knd: unknown key 'knd'"),
    ({"springs": [""]}, "springs.0: must be text that is not empty"),
    ({"named": {"a b": 1}}, "named.a b: must be a name of 1 to 64 letters … not 'a b'"),
    ({"named": {3: 1}}, 'named.3: must be a name of 1 to 64 letters … not 3'),
    ({"latency_ns": "5ms"}, "latency_ns: unknown key 'latency_ns' … did you mean 'latency'"),
]  # fmt: skip


@pytest.mark.parametrize(("params", "text"), MISTAKES)
def test_each_mistake_has_its_sentence(params, text):
    place, *words = text.split(" … ")
    found = problem(**params)
    assert found.startswith(place)
    assert [word for word in words if word not in found] == []


def test_a_law_that_is_misspelt_does_not_spoil_its_parameters():
    assert problem(law="pidd", ki=3).startswith("law: must be")


def test_a_file_is_relative_to_the_folder_of_the_scenario(tmp_path):
    (tmp_path / "robot.urdf").touch()
    (tmp_path / "folder").mkdir()
    given_ = {"joints": ["a"], "model": "robot.urdf"}
    assert Params.of(given_, tmp_path).model == tmp_path / "robot.urdf"
    for name, mistake in (("gone.urdf", "file 'gone.urdf' not found"), ("folder", "is a folder")):
        ((keys, text),) = find_problems(Params, {**given_, "model": name}, tmp_path)
        assert keys == ("model",)
        assert mistake in text


def test_keys_that_are_not_declared_go_to_a_class_of_the_users_own():
    params = Params.of({"joints": ["a"], "law": "my:Law", "ki": 5, "depth": [1]})
    assert params.own == {"ki": 5, "depth": [1]}
    assert params.law == "my:Law"


def test_keys_that_are_null_count_as_absent():
    assert Params.of({"joints": ["a"], "kp": None, "named": {"a": None}}).named == {}


@pytest.mark.parametrize("data", [True, None, [], "x", 3])
def test_what_is_no_map_is_refused(data):
    with pytest.raises(SettingsError):
        Params.of(data)


def test_all_problems_of_a_participant_come_at_once_with_their_path():
    config = Config(
        name="arm", step_ns=1, every=1, seed=0, folder=Path(), inputs={}, outputs={},
        params={"joints": ["a"], "flag": 3, "cuont": 2},
    )  # fmt: skip
    with pytest.raises(SettingsError) as caught:
        config.read(Params)
    flag, count = str(caught.value).splitlines()
    assert flag.startswith("participants.arm.params.flag: ")
    assert count.startswith("participants.arm.params.cuont: ")


def test_numbers_that_fit_no_model_are_named_with_their_whole_path():
    config = Config(
        name="arm", step_ns=1, every=1, seed=0, folder=Path(), inputs={}, outputs={},
        params={"joints": ["a"], "kp": [1]},
    )  # fmt: skip
    with pytest.raises(SettingsError, match="has 1 numbers for 2 joints"):
        config.read(Params).kp.of(["x", "y"])


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text(max_size=5) | st.integers(), inner, max_size=3)
    ),
)
KEYS = st.sampled_from([*Params.__struct_encode_fields__, "x"])


@given(data=st.dictionaries(KEYS, JSON))
def test_any_data_is_read_or_refused_in_sentences(data):
    assert all(text for _, text in find_problems(Params, data))


@given(data=JSON)
def test_any_value_is_read_or_refused_for_any_type(data):
    problems = Problems()
    read(dict[str, Literal["ignore"] | Spring], data, problems)
    assert len(problems) >= (not isinstance(data, dict))


def test_a_participant_that_declares_parameters_loads_no_yaml():
    code = "import stepbus, sys; stepbus.Settings; sys.exit('ruamel.yaml' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
