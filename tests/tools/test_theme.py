"""The colours that everything is drawn in: told apart by every reader, on every page."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from stepbus_tools.theme import LINES, LINES_DARK, MARK, NIGHT, PAPER, line_style

# Machado, Oliveira, Fernandes 2009, severity 1.0, for linear RGB.
BLINDNESS = {
    "none": np.eye(3),
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}  # fmt: skip
# From linear RGB to the cone responses of Oklab, and from their cube roots to its axes.
CONES = [[0.4122215, 0.5363325, 0.0514460], [0.2119035, 0.6806995, 0.1073970], [0.0883025, 0.2817188, 0.6299787]]  # fmt: skip
AXES = [[0.2104543, 0.7936178, -0.0040720], [1.9779985, -2.4285922, 0.4505937], [0.0259040, 0.7827718, -0.8086758]]  # fmt: skip


def linear(color):
    numbers = np.array([int(color[at : at + 2], 16) for at in (1, 3, 5)]) / 255
    return np.where(numbers <= 0.04045, numbers / 12.92, ((numbers + 0.055) / 1.055) ** 2.4)


def seen(color, matrix):
    """Return a colour in Oklab, as somebody with a colour blindness sees it."""
    return AXES @ np.cbrt(CONES @ np.clip(matrix @ linear(color), 0, 1))


def contrast(one, other):
    dark, light = sorted(float(np.dot([0.2126, 0.7152, 0.0722], linear(c))) for c in (one, other))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("blindness", BLINDNESS)
@pytest.mark.parametrize("colors", [LINES, LINES_DARK])
def test_seven_lines_are_told_apart_with_any_colour_blindness(colors, blindness):
    matrix = np.array(BLINDNESS[blindness])
    apart = [np.linalg.norm(seen(a, matrix) - seen(b, matrix)) for a, b in combinations(colors, 2)]
    # Two patches beside each other differ visibly from 0.02 on.
    assert min(apart) > 0.04


@pytest.mark.parametrize(("colors", "page"), [(LINES, PAPER), (LINES_DARK, NIGHT)])
def test_lines_and_texts_stand_out_from_their_page(colors, page):
    assert min(contrast(color, page["paper"]) for color in colors) >= 3.0
    texts = ("ink", "soft", "accent", "good", "bad", "warn")
    for ground in ("paper", "raised"):
        assert min(contrast(page[name], page[ground]) for name in texts) >= 4.5


def test_fourteen_joints_have_a_style_each():
    styles = [line_style(number) for number in range(14)]
    assert len(set(styles)) == 14
    assert line_style(14) == styles[0]


def test_the_site_has_the_same_mark():
    root = Path(__file__).parents[2]
    assert (root / "docs" / "site" / "mark.svg").read_text().strip() == MARK
