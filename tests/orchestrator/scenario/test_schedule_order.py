from __future__ import annotations

import pytest
from support.runs.scenario import TWO_LINK, changed, load_text, problems_of, wiring

from stepbus_orchestrator.scenario.schedule import Schedule


def schedule(folder, text=TWO_LINK, *overrides):
    return Schedule(load_text(folder, text, *overrides))


def test_the_schedule_as_text(tmp_path):
    assert schedule(tmp_path).text(5) == (
        "plant@0 mission@0 controller@0 plant@1 controller@1 plant@2 controller@2 "
        "plant@3 controller@3 plant@4 mission@4 controller@4"
    )


def test_without_a_duration_nobody_closes(tmp_path):
    open_ended = schedule(tmp_path, changed("duration: 10s\n", ""))
    assert open_ended.text(1) == "plant@0 mission@0 controller@0"
    assert not open_ended.closing("plant")
    assert open_ended.closing("plant", 17)


@pytest.mark.parametrize(("end", "closes"), [(6, True), (7, False)])
def test_a_slow_plant_closes_only_where_it_would_fire(tmp_path, end, closes):
    assert schedule(tmp_path, TWO_LINK, "plant.every=3").closing("plant", end) is closes


def test_ties_are_as_in_the_scenario(tmp_path):
    text = wiring("z.x <- a.o -1\n m.x <- a.o -1\n b.x <- z.o")
    assert schedule(tmp_path, text).text(1) == "a@0 m@0 z@0 b@0"


def loops(folder, text):
    return [
        line.partition("algebraic loop ")[2].partition(":")[0] for line in problems_of(folder, text)
    ]


@pytest.mark.parametrize(
    ("links", "named"),
    [
        ("a.x <- c.o\n b.x <- a.o\n c.x <- b.o\n d.x <- c.o", ["a → b → c → a"]),
        ("a.x <- b.o\n b.x <- a.o\n c.x <- d.o\n d.x <- c.o\n d.y <- a.o", ["a → b → a", "c → d → c"]),
        ("a.x <- b.o\n b.x <- a.o\n b.y <- c.o\n c.x <- b.o", ["a → b → a", "b → c → b"]),
        ("a.x <- b.o\n b.x <- a.o\n b.y <- a.o", ["a → b → a"] * 2),
    ],
)  # fmt: skip
def test_every_loop_is_named_along_the_data_by_each_input_that_closes_it(tmp_path, links, named):
    assert loops(tmp_path, wiring(links)) == named


def test_a_loop_at_different_rates_is_a_loop_too(tmp_path):
    text = changed("publishes: first", "every: 2")
    assert loops(tmp_path, text) == ["plant → controller → plant"]


def test_a_delay_breaks_a_loop(tmp_path):
    text = wiring("a.x <- b.o\n b.x <- a.o -1")
    assert schedule(tmp_path, text).order == ("b", "a")


def test_two_that_publish_first_may_read_each_other(tmp_path):
    text = wiring("a.x <- b.o\n b.x <- a.o").replace("{exec", "{publishes: first, exec")
    assert schedule(tmp_path, text).text(1) == "a@0 b@0"
