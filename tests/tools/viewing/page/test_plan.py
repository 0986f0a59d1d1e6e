"""The path of a base from above: what stands in the world is shown whole, or fades."""

import re

import numpy as np

from stepbus_tools.viewing.page.plan import path_from_above

PATH = {"odometry": np.array([[0.0, 0.0], [1.0, 0.2], [2.0, 0.0]])}


def box(x, y, width, depth):
    return np.array([[x, y], [x + width, y], [x + width, y + depth], [x, y + depth]])


def polygons(html):
    """Return whether each outline fades, and its corners in the drawing."""
    rows = re.findall(r'<polygon class="thing" (.*?)points="(.*?)"', html)
    return [
        (
            bool(fades.strip()),
            np.array([[float(n) for n in dot.split(",")] for dot in dots.split()]),
        )
        for fades, dots in rows
    ]


def test_what_the_border_would_cut_is_shown_whole():
    html = path_from_above(PATH, [box(2.2, -0.4, 0.8, 0.4), box(2.8, -1.0, 0.5, 0.6)])
    width, height = map(float, re.search(r'viewBox="0 0 (\S+) (\S+)"', html).groups())
    shown = polygons(html)
    assert [fades for fades, _ in shown] == [False, False]
    for _, corners in shown:
        assert (corners >= 0).all()
        assert (corners <= (width, height)).all()


def test_what_is_far_larger_than_the_path_fades_and_what_is_beyond_is_left_out():
    html = path_from_above(PATH, [box(-20.0, 0.4, 40.0, 0.2), box(50.0, 50.0, 1.0, 1.0)])
    assert [fades for fades, _ in polygons(html)] == [True]
    assert 'id="fade"' in html
