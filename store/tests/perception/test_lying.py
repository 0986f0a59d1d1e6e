"""What the camera makes of items that lie, and of what something else hides."""

import math

import numpy as np
import pytest
from support.services.perception import COLORS, SHAPES, TOPS, Item, open_store

from stepbus_plant.camera import Lens
from stepbus_plant.params import CameraErrors
from stepbus_store.perception.detector import Detector
from stepbus_store.perception.images import make_view
from stepbus_store.perception.item_catalog import read_catalog
from stepbus_store.solids import rotation

HIGH = {"cola": 0.033, "juice": 0.03, "water": 0.032, "soup": 0.035}
"""Height of the axis of an item that lies [m]."""


def look(folder, kind, heading=None, *, x=0.0, spot=None, shade=None, upright=0.3):
    """Return what is seen of an item that lies, if it has a heading, and of one that stands."""
    lens = Lens(CameraErrors(depth=0.004, color=4.0, blur=0.7, light="lamp"), 3)
    with open_store(folder, lens=lens) as store:
        store.board((1.0, 1.0, 0.1), (0.0, 0.0, -0.05))
        bottom = {"water": 0.075}.get(kind, TOPS[kind])
        store.add(Item(f"{kind}_1", kind, (upright, 0.0, bottom)))
        if heading is not None:
            store.lay(kind, (x, 0.0, HIGH[kind]), heading)
        if shade:
            store.board(*shade)
        images, camera = store.look((0.0, 0.0, 0.4))
        detector = Detector(read_catalog("poses", store.description), 0.2, 0.004)
        return detector.look(make_view(images), camera, spot)


@pytest.mark.parametrize("heading", [0.0, 0.7, math.pi / 2, 2.5])
@pytest.mark.parametrize("kind", ["cola", "juice", "water", "soup"])
def test_an_item_that_lies_is_seen_where_it_lies_and_along_its_axis(tmp_path, kind, heading):
    found, _ = look(tmp_path, kind, heading)
    (seen,) = [item for item in found if item.lies]
    assert (seen.type, seen.position[0]) == (kind, pytest.approx(0.0, abs=0.02))
    assert seen.position[1] == pytest.approx(0.0, abs=0.02)
    assert seen.position[2] == pytest.approx(HIGH[kind], abs=0.01)
    assert abs(math.remainder(seen.yaw - heading, math.pi)) < 0.1
    axis = rotation(seen.orientation)[:, 2]
    assert abs(axis @ (math.cos(heading), math.sin(heading), 0.0)) > 0.99


@pytest.mark.parametrize("kind", ["cola", "juice", "water", "soup"])
@pytest.mark.parametrize("x", [-0.1, 0.0, 0.1])
def test_an_item_that_stands_does_not_lie(tmp_path, kind, x):
    found, _ = look(tmp_path, kind, upright=x)
    assert [(item.type, item.lies) for item in found] == [(kind, False)]


def test_an_item_that_stands_beside_one_that_lies_is_told_from_it(tmp_path):
    found, _ = look(tmp_path, "cola", math.pi / 2, x=-0.05, upright=0.02)
    assert [item.lies for item in found] == [False, True]
    assert found[1].position[0] == pytest.approx(-0.05, abs=0.02)


def test_what_is_cut_off_by_the_rim_may_be_anything(tmp_path):
    found, _ = look(tmp_path, "cola", 0.0, x=0.26)
    assert not any(item.lies for item in found)


@pytest.mark.parametrize(
    ("shade", "share"),
    [
        (None, 0.0),
        (((0.2, 0.2, 0.01), (0.0, 0.0, 0.2)), 1.0),
        # Close to the lens.
        (((0.2, 0.2, 0.01), (0.0, 0.0, 0.34)), 1.0),
        # The half of it on the left.
        (((0.2, 0.2, 0.01), (-0.1, 0.0, 0.2)), 0.4),
    ],
)
def test_what_hides_a_spot_is_seen(tmp_path, shade, share):
    _, hidden = look(tmp_path, "cola", spot=(0.0, 0.0, 0.115), shade=shade)
    assert hidden == pytest.approx(share, abs=0.21)
    assert (hidden > 0.5) == (share > 0.5)


def test_beyond_the_image_nothing_is_hidden(tmp_path):
    _, hidden = look(tmp_path, "cola", spot=(5.0, 0.0, 0.115))
    assert hidden == 0.0
    assert np.isfinite(hidden)
    assert set(SHAPES) >= {"cola", "juice", "water", "soup"} <= set(COLORS)
