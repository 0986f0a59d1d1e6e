"""Collision shapes as text, from the plant to perception, planner and mission."""

import pytest

from stepbus_schemas import Shape, parse_shapes


def test_a_text_holds_several_shapes_with_their_poses():
    assert parse_shapes("cylinder 0.03 0.1 @ 0 0 0.5 0 0 1 0; mesh;") == [
        Shape("cylinder", (0.03, 0.1), (0.0, 0.0, 0.5), (0.0, 0.0, 1.0, 0.0)),
        Shape("mesh", (), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
    ]


@pytest.mark.parametrize(
    "text",
    [
        "box 1 2",
        "box a 1 1",
        "sphere -1",
        "sphere nan",
        "sphere 1 @ 0 0 0",
        "box 1 1 1 @ 0 0 0 0 0 0 0",
    ],
)
def test_a_shape_that_cannot_be_read_is_named(text):
    with pytest.raises(ValueError, match=r"cannot parse shape '.*'"):
        parse_shapes(text)
