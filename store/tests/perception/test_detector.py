"""What the detector makes of items that are hidden, cut off, touching, or alike."""

import math

import pytest
from support.services.perception import COLORS, SHAPES, TOPS, Item, open_store

from stepbus_store.perception.detector import Detector
from stepbus_store.perception.images import make_view
from stepbus_store.perception.item_catalog import read_catalog
from stepbus_store.perception.truth import Truth


def stand(kind, x=0.0, y=0.0, n=0, yaw=0.0, z=0.0):
    """Return an item that stands on a height z."""
    return Item(f"{kind}_{n}", kind, (x, y, z + {"water": 0.075}.get(kind, TOPS[kind])), yaw)


def find(folder, *items, eye=(0.0, 0.0, 0.4), least=0.0, yaw=0.0, tilt=(0.0, 0.0), extra=()):
    """Return what is found of the items with a camera at `eye` that looks down; extra: boards."""
    with open_store(folder, *items) as store:
        for size, at in extra:
            store.board(size, at)
        images, camera = store.look(eye, yaw, tilt)
        detector = Detector(read_catalog("poses", store.description), least)
        found = detector.look(make_view(images), camera)[0]
    return [f for f in found if f.confidence > 0.01]


@pytest.mark.parametrize("kind", ["cola", "juice", "water", "soup", "cereal"])
def test_touching_items_of_a_kind_are_told_apart(tmp_path, kind):
    apart = {"cola": 0.068, "soup": 0.072, "water": 0.066, "juice": 0.062, "cereal": 0.052}[kind]
    items = [stand(kind, apart * n, 0.0, n) for n in (-1, 0, 1)]
    found = find(tmp_path, *items, least=0.5)
    assert len(found) == 3
    for item, one in zip(items, sorted(found, key=lambda f: f.position), strict=True):
        assert math.dist(item.position, one.position) < 3e-3


def test_an_item_on_the_edge_of_the_image_is_less_sure(tmp_path):
    (whole,), (half,) = (find(tmp_path, stand("cola", x)) for x in (0.0, 0.2))
    assert whole.confidence > 0.95
    assert 0.2 < half.confidence < 0.8
    assert half.position[0] == pytest.approx(0.2, abs=3e-3)


def test_an_item_behind_a_board_is_less_sure_and_still_in_its_place(tmp_path):
    shade = ((0.04, 0.2, 0.01), (0.02, 0.0, 0.25))
    (found,) = find(tmp_path, stand("cola"), extra=[shade])
    assert 0.3 < found.confidence < 0.8
    assert found.position[:2] == pytest.approx((0.0, 0.0), abs=2e-3)


def test_a_box_is_turned_as_it_stands(tmp_path):
    (found,) = find(tmp_path, stand("cereal", yaw=math.radians(70)), yaw=0.4)
    assert math.degrees(found.yaw) == pytest.approx(70, abs=0.7)


def test_the_place_of_an_item_is_its_centre_wherever_its_link_has_its_origin(tmp_path, monkeypatch):
    monkeypatch.setitem(SHAPES, "cereal", "box 0.05 0.08 0.1 @ 0.01 -0.02 0.05 0 0 0 1")
    item = Item("cereal_0", "cereal", (0.03, 0.04, 0.0), 0.5)
    with open_store(tmp_path, item) as store:
        catalog = read_catalog("poses", store.description)
        images, camera = store.look((0.0, 0.0, 0.4))
        (found,) = Detector(catalog, 0.5).look(make_view(images), camera)[0]
        told = Truth("poses", store.description.names, catalog, "chassis").detections(store.poses())
    assert found.position == pytest.approx(told.position[0], abs=1e-3)
    c, s = math.cos(0.5), math.sin(0.5)
    at = (0.03 + 0.01 * c + 0.02 * s, 0.04 + 0.01 * s - 0.02 * c, 0.05)
    assert told.position[0] == pytest.approx(at)


def test_kinds_of_one_colour_are_told_apart_by_their_tops(tmp_path, monkeypatch):
    for kind in ("juice", "soup", "water"):
        monkeypatch.setitem(COLORS, kind, COLORS["cola"])
    items = [stand("juice", 0.0, 0.0), stand("soup", 0.09, 0.0), stand("water", -0.09, 0.0)]
    found = find(tmp_path, *items, least=0.5)
    assert [f.type for f in sorted(found, key=lambda f: f.position)] == ["water", "juice", "soup"]


def test_a_bottle_without_its_neck_in_view_is_found_by_its_shoulder(tmp_path):
    shade = ((0.034, 0.034, 0.01), (0.0, 0.0, 0.2))
    (found,) = find(tmp_path, stand("water"), eye=(0.0, 0.0, 0.45), extra=[shade])
    assert math.dist(found.position, (0.0, 0.0, 0.075)) < 3e-3


def test_a_thing_of_the_right_colour_and_another_size_is_not_taken_for_the_item(tmp_path):
    with open_store(tmp_path, stand("cola")) as store:
        described = store.description
        described.details["shape"][1] = "cylinder 0.02 0.115"
        images, camera = store.look((0.0, 0.0, 0.4))
        assert (
            Detector(read_catalog("poses", described), 0.2).look(make_view(images), camera)[0] == []
        )


def test_a_camera_that_sees_only_sky_finds_nothing(tmp_path):
    assert find(tmp_path, stand("cola"), tilt=(math.pi, 0.0)) == []
