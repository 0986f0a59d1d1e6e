import contextlib
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepbus_schemas import WiringError
from stepbus_tools.sweep.axes import Design, Sampling, parse_axis


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("a.b=50:200:4", [50, 100, 150, 200]),
        ("a.b=0:1:3", [0.0, 0.5, 1.0]),
        ("a.b=1:100:3:log", [1, 10, 100]),
        ("a.b=2.0:4.0:3", [2.0, 3.0, 4.0]),
        ("a.b[1].c=1,2", [1, 2]),
        ("a.b=1,2.5,true,word", [1, 2.5, True, "word"]),
        ("a.b=[1,2],[3,4]", [[1, 2], [3, 4]]),
        ("faults=none,kill plant at 100", ["none", "kill plant at 100"]),
        ("duration=1s,2s", ["1s", "2s"]),
    ],
)
def test_an_axis_has_these_values(text: str, values: list[object]) -> None:
    axis = parse_axis(text)
    assert [value for (value,) in axis.values] == values
    assert [type(value) for (value,) in axis.values] == [type(value) for value in values]


def test_values_vary_together() -> None:
    axis = parse_axis("a.kp=1,2,3 & a.kd=4:6:3")
    assert axis.paths == ("a.kp", "a.kd")
    assert axis.values == ((1, 4), (2, 5), (3, 6))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a.b", "write PATH=VALUES"),
        ("a.b=", "write PATH=VALUES"),
        ("a.b=1:2:0", "a range must have 1 to 100000 values"),
        ("a.b=-1:2:3:log", "both ends of a logarithmic range must be above 0"),
        ("a.b=2:1", "the start of a range must be below its end"),
        ("a=1,2 & b=3", "need equally many values; a has 2, b has 1"),
        ("a~normal(1, 0.1) & b=3", "vary together"),
        ("a~normal(1, -0.1)", "does not accept these parameters"),
        ("a~normall(1, 0.1)", "did you mean 'normal'?"),
        ("a~normal(x)", "must be numbers or quoted strings"),
        ("a~normal(1, 2, 3, 4)", "a~normal(1, 2, 3, 4): "),
        ("a~uniform(0, 0)", "does not accept these parameters"),
        ("a~choice()", "choice needs its values"),
        ("a=[1", "not a YAML list"),
    ],
)
def test_what_is_no_axis_says_why(text: str, sentence: str) -> None:
    with pytest.raises(WiringError) as caught:
        parse_axis(text)
    assert sentence in str(caught.value)
    assert text in str(caught.value)


def test_a_design_is_the_product_of_grids_draws_and_repeats() -> None:
    axes = [parse_axis(text) for text in ("a=1,2", "b~uniform(0, 1)", "c=x,y,z")]
    design = Design(axes, samples=5, repeats=2, first_seed=7)
    points = list(design)
    assert len(design) == len(points) == 2 * 3 * 5 * 2
    assert [point.number for point in points] == list(range(60))
    assert {(p.values["a"], p.values["c"]) for p in points} == {
        (a, c) for a in (1, 2) for c in "xyz"
    }
    assert [p.values["seed"] for p in points[:4]] == [7, 8, 7, 8]
    # Each combination has the same draws, in the same order.
    draws = [[p.values["b"] for p in points[n : n + 10]] for n in range(0, 60, 10)]
    assert all(row == draws[0] for row in draws)
    assert len(set(draws[0])) == 5


@pytest.mark.parametrize("sampling", get_args(Sampling))
def test_the_same_seed_draws_the_same(sampling: str) -> None:
    def drawn(seed: int) -> list[float]:
        axes = [parse_axis("a~normal(1, 0.1)"), parse_axis("b~randint(0, 10)")]
        design = Design(axes, samples=16, sampling=sampling, seed=seed)
        return [value for point in design for value in point.values.values()]

    assert drawn(3) == drawn(3)
    assert drawn(3) != drawn(4)


def test_latin_and_sobol_samples_fill_the_space() -> None:
    for sampling in ("latin", "sobol"):
        design = Design([parse_axis("a~uniform(0, 1)")], samples=64, sampling=sampling)
        found = sorted(point.values["a"] for point in design)
        assert np.array_equal(np.floor(np.array(found) * 64), np.arange(64)), sampling


@pytest.mark.parametrize(
    ("texts", "options", "sentence"),
    [
        (["a=1", "a=2"], {}, "a: on two axes"),
        (["a~normal(0, 1)"], {}, "--samples"),
        (["a=1"], {"samples": 3}, "no axis has a distribution"),
        (["seed=1,2"], {"repeats": 2}, "seed: use either"),
    ],
)
def test_axes_that_do_not_go_together(
    texts: list[str], options: dict[str, int], sentence: str
) -> None:
    with pytest.raises(WiringError, match=sentence):
        Design([parse_axis(text) for text in texts], **options)


@given(st.text(max_size=30))
def test_any_text_is_an_axis_or_one_sentence(text: str) -> None:
    with contextlib.suppress(WiringError):
        assert parse_axis(f"a.b={text}").paths
