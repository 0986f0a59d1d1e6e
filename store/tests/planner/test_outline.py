"""Distances of points to convex outlines."""

import numpy as np
import pytest

from stepbus_store.planner.outline import Outline, distances, hull


def reference(point, corners):
    """Return the distance of a point to an outline, side by side."""
    away, is_inside = [], True
    for here, there in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge, offset = there - here, point - here
        share = np.clip(offset @ edge / (edge @ edge), 0.0, 1.0)
        away.append(np.hypot(*(offset - share * edge)))
        is_inside = is_inside and edge[0] * offset[1] >= edge[1] * offset[0]
    return 0.0 if is_inside else min(away)


@pytest.mark.parametrize("seed", range(20))
def test_distances_are_those_of_the_nearest_side_and_0_inside(seed):
    random = np.random.default_rng(seed)
    corners, points = hull(random.normal(size=(7, 2))), random.normal(size=(40, 2))
    expected = [reference(point, corners) for point in points]
    assert distances(points, corners) == pytest.approx(expected, abs=1e-12)
    assert 0.0 in distances(points, corners)


@pytest.mark.parametrize("seed", range(20))
def test_what_is_near_enough_is_never_left_out(seed):
    random = np.random.default_rng(seed)
    outline = Outline(link="box", corners=hull(random.normal(size=(7, 2))))
    points = random.normal(size=(5, 2)) + random.normal(size=2) * 3
    low, high = points.min(axis=0), points.max(axis=0)
    nearest = distances(points, outline.corners).min()
    assert outline.may_be_near(low, high, nearest)
    assert not outline.may_be_near(low + 100.0, high + 100.0, 1.0)
