from __future__ import annotations

import copy
import io

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML
from scenario_support import TWO_LINK, plain, write

from stepbus_orchestrator.scenario import Scenario, ScenarioError, load

SCALARS = [None, True, -1, 0, 1.5, 2**63, "", ".", "a.b", "5ms", "unix", "first", "\x00", "x" * 300]
MAPS = [{"a": None}, {"from": []}, {"type": {}}, {"params": {"x": "../"}}]
ODD = st.sampled_from([*SCALARS, [], {}, [None], [[]], *MAPS])
ENCODABLE = st.characters(codec="utf-8")
FUZZ = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=30
)


def ends_well(path, overrides=()):
    try:
        return isinstance(load(path, overrides), Scenario)
    except ScenarioError as exc:
        return all(problem.message for problem in exc.problems)


def replaced(data, value, pick):
    """Return the data with `value` in place of one of its values; pick: number → choice."""
    keys = list(data) if isinstance(data, dict) else list(range(len(data)))
    if not keys:
        return data
    changed, key = copy.copy(data), keys[pick(len(keys))]
    deeper = isinstance(data[key], dict | list) and pick(4)
    changed[key] = replaced(data[key], value, pick) if deeper else value
    return changed


@FUZZ
@given(values=st.lists(ODD, min_size=1, max_size=4), choices=st.data())
def test_values_of_any_kind_end_in_a_scenario_or_in_problems(tmp_path, values, choices):
    data = plain()
    for value in values:
        data = replaced(data, value, lambda n: choices.draw(st.integers(0, n - 1)))
    text = io.StringIO()
    YAML(typ="safe", pure=True).dump(data, text)
    assert ends_well(write(tmp_path, text.getvalue()))


@FUZZ
@given(at=st.integers(0, len(TWO_LINK)), cut=st.integers(0, 30), put=st.text(ENCODABLE, max_size=4))
def test_broken_text_ends_in_a_scenario_or_in_problems(tmp_path, at, cut, put):
    assert ends_well(write(tmp_path, TWO_LINK[:at] + put + TWO_LINK[at + cut :]))


PARTS = st.sampled_from(
    ["plant", "participants", "params", "inputs", "exec", "0", "bus", "step", ""]
)


@FUZZ
@given(path=st.lists(PARTS | st.text(max_size=3), max_size=5), value=ODD)
def test_any_setting_ends_in_a_scenario_or_in_problems(tmp_path, path, value):
    assert ends_well(write(tmp_path), [f"{'.'.join(path)}={value}"])
