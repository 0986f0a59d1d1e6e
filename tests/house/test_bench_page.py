"""The page that `make bench` writes: ratios are those within a round."""

import pytest
from benchmarks.suite.cases import CHAIN, all_cases
from benchmarks.suite.page import END, PLOT, START, ratio, write_page

MACHINE = {"load": 1.0, "stolen_s": 0.5, "ping_pong_us": 10.0, "machine": "a machine"}


def row(number, case, rate, **more):
    figures = {"cpu_us": 100.0, "wake_ups": 5.6, "p50": 1.0, "p99": 2.0, "max": 3000.0}
    return {"round": number, "case": case, "rate": rate, **figures, **MACHINE, **more}


ROWS = [
    row(0, CHAIN, 1000.0),
    row(0, "two_link, window 64", 500.0, bytes=183.2, memory=[60.0, 90.0]),
    # A round in which the machine was ten times slower.
    row(1, CHAIN, 100.0),
    row(1, "two_link, window 64", 60.0, bytes=183.2, memory=[60.0, 90.0]),
    {"round": 0, "case": "mosaik 3.6", "machine": "a machine", "failed": "it ended with 1"},
]


def test_a_ratio_is_the_median_of_those_within_a_round():
    chain, arm = ([r for r in ROWS if r["case"] == name] for name in (CHAIN, "two_link, window 64"))
    assert ratio(arm, chain, "rate") == pytest.approx(0.55)
    assert ratio(arm, [], "rate") is None


def test_the_page_keeps_its_text_and_gets_the_table(tmp_path):
    page = tmp_path / "performance.md"
    page.write_text(f"before\n\n{START}\nold\n{END}\nafter\n")
    write_page(page, [CHAIN, "two_link, window 64", "mosaik 3.6"], ROWS)
    text = page.read_text()
    assert text.startswith(f"before\n\n{START}\nMedians of 2 interleaved rounds")
    assert text.endswith(f"{END}\nafter\n")
    assert "old" not in text
    line = "| two_link, window 64 | 280 | 0.55 | 100 | 1.00 | 5.6 | 1 | 2 | 3.0 | 183 | 60 90 |\n"
    assert line in text
    assert "Not measured: mosaik 3.6." in text
    assert (tmp_path / PLOT).stat().st_size > 1000


def test_each_case_has_a_name_of_its_own():
    names = [case.name for case in all_cases()]
    assert len(set(names)) == len(names)
    assert CHAIN in names
