"""What a protocol number stands for never changes: each change of the wire has a number of its own."""

import copy
import re

import pytest
from scripts.generate_messages import broken, main, published, published_vectors


def test_each_vector_of_this_number_means_what_it_meant_when_it_was_published():
    assert broken(published_vectors()) == {}


def test_a_trigger_with_another_name_breaks_the_number():
    vectors = copy.deepcopy(published_vectors())
    data = next(iter(vectors["Trigger/1"]["exact"]))
    vectors["Trigger/1"]["exact"] = {data.replace(b"step_limit".hex(), b"limit_step".hex()): ""}
    assert list(broken(vectors)) == ["Trigger/1"]


def test_generate_writes_nothing_over_a_broken_number(monkeypatch, capsys):
    vectors = copy.deepcopy(published_vectors())
    vectors["Trigger/1"]["exact"] |= {b"\x81\xa5token\xa10".hex(): ""}
    monkeypatch.setattr("scripts.generate_messages.published_vectors", lambda: vectors)
    monkeypatch.setattr("scripts.generate_messages.generated_files", lambda _: pytest.fail("wrote"))
    assert main([]) == 1
    assert re.search(r"Trigger/1: 1 vectors .* raise PROTOCOL_VERSION", capsys.readouterr().out)


def test_vectors_are_added_and_none_is_changed():
    before = {"Trigger/1": {"exact": {"80": ""}, "accepted": {"81": "80"}, "refused": {}}}
    rows = {"exact": [{"hex": "82"}], "accepted": [{"hex": "81", "value": 7}], "refused": []}
    now = published(before, {"types": {"Trigger/1": rows}})
    assert now["Trigger/1"] == {
        "exact": {"80": "", "82": ""},
        "accepted": {"81": "80"},
        "refused": {},
    }
