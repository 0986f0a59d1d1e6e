"""Round marks on shelves and outlet, as the camera sees them."""

import math

import numpy as np
import pytest
from support.services.perception import COLORS, SHAPES, TOPS, Item, open_store

from stepbus_plant.camera import Lens
from stepbus_plant.params import CameraErrors
from stepbus_schemas import Description, WiringError
from stepbus_store.perception.detector import Detector
from stepbus_store.perception.images import make_view
from stepbus_store.perception.item_catalog import read_catalog, with_landmarks

RADIUS = 0.015
PINK = (0.9, 0.1, 0.7)
PLACES = [(-0.08, 0.05), (0.08, 0.05), (0.0, -0.07)]
NOISE = 0.004


@pytest.fixture(autouse=True)
def _marks(monkeypatch):
    """Have flat discs among the things that can be put into the scene."""
    monkeypatch.setitem(SHAPES, "mark", f"cylinder {RADIUS} 0.002 @ 0 0 0 0 0 0 1")
    monkeypatch.setitem(COLORS, "mark", PINK)
    monkeypatch.setitem(TOPS, "mark", 0.001)


def described(color="0.9 0.1 0.7"):
    names = ["cola_1", *(f"landmark_{n}" for n in range(len(PLACES)))]
    rest = len(PLACES)
    return Description(
        names=names,
        details={
            "type": ["cola", *[""] * rest],
            "shape": [SHAPES["cola"], *[""] * rest],
            "color": ["0.8 0.1 0.1", *[color] * rest],
        },
    )


def catalog(**changes):
    given = described(**changes)
    return with_landmarks(read_catalog("poses", given), "poses", given, "landmark", RADIUS)


def find(folder, *, lens=None, noise=0.0):
    marks = [Item(f"mark_{n}", "mark", (*at, 0.3), 0.0) for n, at in enumerate(PLACES)]
    cola = Item("cola_1", "cola", (0.0, 0.02, 0.3 + TOPS["cola"]), 0.0)
    with open_store(folder, *marks, cola, lens=lens) as store:
        store.board((0.4, 0.4, 0.299), (0.0, 0.0, 0.1495))
        images, camera = store.look((0.0, 0.0, 0.75))
        return Detector(catalog(), 0.2, noise).look(make_view(images), camera)[0]


@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_all_are_found_where_they_are_among_items(tmp_path, noise):
    lens = Lens(CameraErrors(depth=noise, color=4.0, blur=0.7, light="lamp"), 1) if noise else None
    found = find(tmp_path, lens=lens, noise=noise)
    marks = sorted(one.position[:2] for one in found if one.type == "landmark")
    assert len(marks) == len(PLACES)
    away = [math.dist(one, at) for one, at in zip(marks, sorted(PLACES), strict=True)]
    assert max(away) < (2e-3 if noise else 1e-3)
    assert [one.type for one in found].count("cola") == 1


def test_their_height_is_that_of_the_disc(tmp_path):
    heights = [one.position[2] for one in find(tmp_path) if one.type == "landmark"]
    assert np.array(heights) == pytest.approx(0.301, abs=1.5e-3)


def test_links_without_the_name_are_no_landmarks():
    given = described()
    with pytest.raises(WiringError, match="no link whose name begins with 'beacon'"):
        with_landmarks(read_catalog("poses", given), "poses", given, "beacon", RADIUS)


def test_landmarks_need_a_colour():
    with pytest.raises(WiringError, match="landmark 'landmark_0' has no colour"):
        catalog(color="")
